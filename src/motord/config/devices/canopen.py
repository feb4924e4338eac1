"""`[inverter.can.canopen]`: what a CANopen drive is sent besides its command."""

from typing import Annotated

from pydantic import Field

from motord.config.base import Section
from motord.config.timing import SILENCE_MAX_S


class CanopenConfig(Section):
    """`[inverter.can.canopen]`: what a CANopen drive is sent besides its command; nothing at first.

    Mapping, mode of operation and what the drive does when heartbeats end are set beforehand.
    """

    start_node: Annotated[int, Field(ge=0, le=127)] | None = None
    """Node that NMT starts when the bus is opened; 0: all nodes."""
    sync: bool = False
    """SYNC after each command, for PDOs that are in force at SYNC (transmission types 0 to 240)."""
    heartbeat_node: Annotated[int, Field(ge=1, le=127)] | None = None
    """Node of motord itself: heartbeats are sent as from this node."""
    heartbeat_s: Annotated[float, Field(gt=0, le=SILENCE_MAX_S)] = 0.05
    """Period of the heartbeats; each comes with a command, so none comes while there are none."""
