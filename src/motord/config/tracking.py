"""`[tracking]`: whether the calibration in force is followed in ordinary operation."""

from typing import Annotated

from pydantic import Field

from motord.config.base import Section


class TrackingConfig(Section):
    """`[tracking]`: gains, offsets and cogging torque in ordinary operation, with forgetting."""

    enabled: bool = False
    """Follow the calibration in force while it is applied, in a process of 200 MB."""
    memory_s: Annotated[float, Field(ge=10, le=3600)] = 300.0
    """Time after which a turn counts 1/e: a longer one makes intervals narrower, and slower."""
