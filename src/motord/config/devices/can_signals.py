"""`[inverter.can]` `signals` and `canopen`, `[inverter.dq]`: a drive's messages and axes."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from motord.config.base import Finite, Mask, Section
from motord.config.timing import DELAY_MAX_S, SILENCE_MAX_S
from motord.section.quantities import AngleSigned, Scale

Phases = tuple[str, str, str] | tuple[()]


class CanSignalMap(Section):
    """Names in the DBC of what motord sends and reads: `Message.Signal`.

    The command is one message, of phase currents or of currents along the rotor's axes. The
    feedback may lie in several messages, each with a counter and a CRC of its own, or none. The
    masks are which bits of the drive's status word mean what.
    """

    command_i_A: Phases = ()
    """Current command of phases a, b, c, in one message."""
    command_i_d_A: str = ""
    """Current command along d, if the drive takes one."""
    command_i_q_A: str = ""
    """Current command along q, in place of phase currents."""
    command_enable: str
    """Signal that enables; "" for a drive that is always on."""
    command_enable_value: Mask = 1
    """What enables."""
    command_disable_value: Mask = 0
    """What disables."""
    command_constants: dict[str, Finite] = Field(default_factory=dict)
    """Other signals of the command and their values."""
    command_counter: str = ""
    """Signal that counts commands up."""
    command_crc: str = ""
    """Signal with the command's CRC."""
    feedback_i_A: Phases = ()
    """Sensed currents of phases a, b, c."""
    feedback_i_d_A: str = ""
    """Sensed current along d."""
    feedback_i_q_A: str = ""
    """Sensed current along q, in place of phase currents."""
    feedback_u_V: Phases = ()
    """Voltages of phases a, b, c."""
    feedback_u_d_V: str = ""
    """Voltage along d."""
    feedback_u_q_V: str = ""
    """Voltage along q, in place of phase voltages."""
    feedback_u_bus_V: str = ""
    """Voltage of the DC bus."""
    feedback_temperature_C: str = ""
    """Temperature of the power stage."""
    feedback_status: str
    """Status word; "" for a drive that says nothing of its state."""
    feedback_counter: tuple[str, ...] = ()
    """Counters, of each message of feedback that has one."""
    feedback_crc: tuple[str, ...] = ()
    """CRCs, of each message of feedback that has one."""
    status_ready_mask: Mask = 1
    """Bits that are all set while the power stage follows commands; 0: it does not say, and counts
    as following them unless status_timeout_mask shows that they were missing."""
    status_fault_mask: Mask = 2
    """Bits of which any means a fault; 0: it does not say."""
    status_timeout_mask: Mask = 4
    """Bits of which any means that commands were missing; 0: it does not say."""
    status_enable_line_mask: Mask = 8
    """Bits of which any means that the enable line is closed; 0: it does not say."""
    status_ready_value: Mask | None = None
    """The masked bits have this value when ready, instead."""
    status_fault_value: Mask | None = None
    """The masked bits have this value at a fault, instead."""
    status_timeout_value: Mask | None = None
    """The masked bits have this value when commands were missing, instead."""
    status_enable_line_value: Mask | None = None
    """The masked bits have this value while the line is closed, instead."""

    @property
    def rotating(self) -> bool:
        """True if the command is currents along the rotor's axes, not of phases."""
        return bool(self.command_i_q_A)

    @property
    def q_only(self) -> bool:
        """True if the drive takes the current along q alone."""
        return self.rotating and not self.command_i_d_A

    @model_validator(mode="after")
    def _one_kind_of_command(self) -> "CanSignalMap":
        if bool(self.command_i_A) == self.rotating:
            raise ValueError(
                "needs either command_i_A, for a drive that takes phase currents, or "
                "command_i_q_A (and command_i_d_A), for one that takes currents along d and q"
            )
        if self.command_i_d_A and not self.rotating:
            raise ValueError("command_i_d_A needs command_i_q_A")
        if self.command_enable_value == self.command_disable_value:
            raise ValueError("command_enable_value and command_disable_value must differ")
        return self

    @model_validator(mode="after")
    def _values_are_of_the_masks(self) -> "CanSignalMap":
        for name in ("ready", "fault", "timeout", "enable_line"):
            mask = getattr(self, f"status_{name}_mask")
            value = getattr(self, f"status_{name}_value")
            if value is not None and value & ~mask:
                raise ValueError(
                    f"status_{name}_value = {value} has bits that status_{name}_mask = {mask} lacks"
                )
        return self

    @model_validator(mode="after")
    def _one_kind_of_feedback(self) -> "CanSignalMap":
        if bool(self.feedback_i_A) == bool(self.feedback_i_q_A):
            raise ValueError(
                "needs either feedback_i_A, for phase currents, or feedback_i_q_A (and "
                "feedback_i_d_A), for currents along d and q"
            )
        if (self.feedback_i_d_A or self.feedback_u_d_V) and not self.feedback_i_q_A:
            raise ValueError("feedback_i_d_A and feedback_u_d_V need feedback_i_q_A")
        if self.feedback_i_q_A and not self.rotating:
            raise ValueError("feedback_i_q_A needs command_i_q_A")
        if bool(self.feedback_u_d_V) != bool(self.feedback_u_q_V):
            raise ValueError("feedback_u_d_V and feedback_u_q_V go together")
        if self.feedback_u_V and self.feedback_u_q_V:
            raise ValueError("needs feedback_u_V or feedback_u_d_V and feedback_u_q_V, not both")
        return self


class DqConfig(Section):
    """`[inverter.dq]`: how the drive's d and q axes lie, as it uses them itself.

    With all defaults d points along the magnets' flux as the configured back-EMF has it, and
    positive current along q makes torque in the bench's positive direction.
    """

    direction: Literal[1, -1] = 1
    """-1: the drive's own positive direction is the bench's negative one."""
    d_axis_rad: AngleSigned = 0.0
    """Electrical angle by which the drive's d axis is ahead of the flux, in its own direction."""
    scale: Scale = 1.0
    """What the drive calls 1 A, or 1 V, of phase amplitude: 1.2247 where its transformation keeps
    the power, 0.7071 where it says r.m.s., 1000 / rated current where it takes thousandths."""
    angle: Literal["turning", "latched"] = "turning"
    """`"turning"`: it turns its set-point with the rotor between commands, as field orientation
    does; `"latched"`: it makes phase currents of it once, when it arrives."""
    angle_age_s: Annotated[float, Field(ge=0, le=DELAY_MAX_S)] = 0.0
    """How old the angle that the drive uses is when its current flows."""


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
