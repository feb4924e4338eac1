"""`[inverter.can.signals]` and `[inverter.dq]`: what a drive's messages and axes mean."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from motord.config.base import Finite, NonNegative, Positive, Section

Phases = tuple[str, str, str] | tuple[()]


class CanSignalMap(Section):
    """Names in the DBC of what motord sends and reads: `Message.Signal`.

    The command is one message, of phase currents (`command_i_A`) or of currents along the rotor's
    axes (`command_i_q_A`, and `command_i_d_A` if the drive takes one). The feedback may lie in
    several messages, each with a counter and a CRC of its own, or none. A drive that is always on,
    or says nothing of its state, has "" for `command_enable` or `feedback_status`.
    `command_constants` sets other signals of the command. The masks are which bits of the drive's
    status word mean what (0 = the drive has none): all of them for ready, any for the others;
    or, with a value besides, that the bits of the mask have that value.
    """

    command_i_A: Phases = ()
    command_i_d_A: str = ""
    command_i_q_A: str = ""
    command_enable: str
    command_enable_value: Annotated[int, Field(ge=0)] = 1
    command_disable_value: Annotated[int, Field(ge=0)] = 0
    command_constants: dict[str, Finite] = Field(default_factory=dict)
    command_counter: str = ""
    command_crc: str = ""
    feedback_i_A: Phases = ()
    feedback_i_d_A: str = ""
    feedback_i_q_A: str = ""
    feedback_u_V: Phases = ()
    feedback_u_d_V: str = ""
    feedback_u_q_V: str = ""
    feedback_u_bus_V: str = ""
    feedback_temperature_C: str = ""
    feedback_status: str
    feedback_counter: tuple[str, ...] = ()
    feedback_crc: tuple[str, ...] = ()
    status_ready_mask: Annotated[int, Field(ge=0)] = 1
    status_fault_mask: Annotated[int, Field(ge=0)] = 2
    status_timeout_mask: Annotated[int, Field(ge=0)] = 4
    status_enable_line_mask: Annotated[int, Field(ge=0)] = 8
    status_ready_value: Annotated[int, Field(ge=0)] | None = None
    status_fault_value: Annotated[int, Field(ge=0)] | None = None
    status_timeout_value: Annotated[int, Field(ge=0)] | None = None
    status_enable_line_value: Annotated[int, Field(ge=0)] | None = None

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
    positive current along q makes torque in the bench's positive direction. direction -1: the
    drive's own positive direction is the bench's negative one. d_axis_rad: electrical angle by
    which the drive's d axis is ahead of the flux, in its own direction. scale: what the drive calls
    1 A, or 1 V, of phase amplitude (1.2247 where it keeps the power, 0.7071 where it says r.m.s.).

    angle: "turning" for a drive that turns its set-point with the rotor between commands, as field
    orientation does; "latched" for one that makes phase currents of it once, when it arrives.
    angle_age_s: how old the angle that the drive uses is when its current flows.
    """

    direction: Literal[1, -1] = 1
    d_axis_rad: Finite = 0.0
    scale: Positive = 1.0
    angle: Literal["turning", "latched"] = "turning"
    angle_age_s: NonNegative = 0.0
