"""Operation by hand: torque as set, speed held by the brake if one is set.

What is asked for is checked whole before any of it is done: `check`, the only place for it.
"""

from motord.api.errors import RpcError
from motord.api.messages import SetpointView
from motord.api.requests import Set
from motord.config import Config
from motord.schema import State
from motord.sequencing.brake_servo import BrakeServo
from motord.sequencing.limits import check_brake, check_drive, check_speed, check_torque
from motord.sequencing.observation import Observation
from motord.sequencing.settings import COMPENSATE, PlanError
from motord.service.bench.setpoint import Setpoint

WATCHED = (State.READY, State.ENABLED)
"""States in which the interlocks watch the rotor's speed: in others the drive stands."""


class Hand:
    """What an operator has set. A brake that has to rise leads the torque, as in a plan."""

    def __init__(self, config: Config, setpoint: Setpoint) -> None:
        self._config = config
        self._setpoint = setpoint
        self._servo = BrakeServo(config.brake)
        self._torque_Nm = 0.0
        self._lead_s = 0.0
        self._lead_from_ns: int | None = None  # Unix ns of the first look after `set`
        self._when_enabled: Set | None = None

    @property
    def waits_for_enabled(self) -> bool:
        """True while something was set that is to be done once the bench is enabled."""
        return self._when_enabled is not None

    def check(self, asked: Set, state: State) -> None:
        """Raise RpcError if the bench cannot or may not do what `asked` holds; changes nothing."""
        if self._when_enabled is not None:
            raise RpcError("refused", "the bench is being enabled; try again when it is")
        if asked.torque_Nm and state is not State.ENABLED and not asked.enable:
            raise RpcError("refused", f"the bench is {state.name}: enable it first")
        torque_Nm, speed_Hz = self._wanted(asked)
        try:
            check_torque(self._config, torque_Nm)
            if asked.drive_Hz is not None:
                check_drive(self._config, asked.drive_Hz)
            if speed_Hz is not None:
                check_speed(self._config, speed_Hz)
                _check_signs(torque_Nm, speed_Hz)
                check_brake(self._config, torque_Nm, speed_Hz)
        except PlanError as error:
            raise RpcError("refused", str(error)) from None
        if asked.drive_Hz and state not in WATCHED and not asked.enable:
            raise RpcError(
                "refused",
                f"the bench is {state.name}: the rotor's speed is watched in READY and ENABLED "
                "alone; enable it first (disabled again it is READY)",
            )

    def set(self, asked: Set, state: State) -> None:
        """Take over what `asked` holds, or keep it until the bench is enabled. Raises RpcError."""
        self.check(asked, state)
        if asked.enable and state is not State.ENABLED:
            self._when_enabled = asked
        else:
            self._take_over(asked)

    def look(self, seen: Observation) -> None:
        """Go on: torque once the brake is there, then the brake until the speed is right."""
        s = self._setpoint
        if seen.state is not State.ENABLED:
            return
        if self._when_enabled is not None:
            asked, self._when_enabled = self._when_enabled, None
            self._take_over(asked)
        if s.torque_Nm != self._torque_Nm:
            if self._lead_from_ns is None:
                self._lead_from_ns = seen.t_ns
            if (seen.t_ns - self._lead_from_ns) * 1e-9 < self._lead_s:
                return
            s.torque_Nm = self._torque_Nm
            self._servo.start(seen.t_ns)
        elif s.speed_Hz is not None and s.torque_Nm != 0.0:
            self._servo.correct(seen.t_ns, seen.speed_Hz, s.speed_Hz)
            s.brake = self._servo.excitation(s.torque_Nm, s.speed_Hz)

    def rest(self) -> None:
        """Forget what was set: no torque, no speed, open brake, standing drive."""
        self.drop_torque()
        self._setpoint.rest()
        self._servo.drop_unproven()

    def drop_torque(self) -> None:
        """No more torque; brake and drive stay as they are."""
        self._when_enabled = None
        self._torque_Nm = self._setpoint.torque_Nm = 0.0

    def view(self) -> SetpointView:
        """Return the set-point, with the torque that it is on its way to."""
        return self._setpoint.view(torque_target_Nm=self._torque_Nm)

    def reached_in_s(self, torque_set_Nm: float) -> float:
        """Return how long the ramp from `torque_set_Nm` takes, with the brake's lead before it."""
        waits = self._setpoint.torque_Nm != self._torque_Nm
        ramp_Nm = abs(self._torque_Nm - torque_set_Nm)
        lead_s = self._lead_s if waits else 0.0
        return lead_s + ramp_Nm / self._config.limits.torque_rate_Nm_per_s

    def _wanted(self, asked: Set) -> tuple[float, float | None]:
        """Return torque (Nm) and speed (Hz, None: not held) as they would be with `asked`."""
        torque_Nm = self._torque_Nm if asked.torque_Nm is None else asked.torque_Nm
        speed_Hz = self._setpoint.speed_Hz if asked.brake is None else None
        return torque_Nm, speed_Hz if asked.speed_Hz is None else asked.speed_Hz

    def _take_over(self, asked: Set) -> None:
        s = self._setpoint
        torque_Nm, speed_Hz = self._wanted(asked)
        if asked.compensate is not None:
            s.compensate = COMPENSATE[asked.compensate]
        if asked.drive_Hz is not None:
            s.drive_Hz = asked.drive_Hz
        if asked.brake is not None:
            s.brake = asked.brake
        self._torque_Nm, s.speed_Hz = torque_Nm, speed_Hz
        self._lead_s = self._bring_brake(torque_Nm, speed_Hz)
        self._lead_from_ns = None
        if self._lead_s == 0.0 or abs(torque_Nm) < abs(s.torque_Nm):
            s.torque_Nm = torque_Nm

    def _bring_brake(self, torque_Nm: float, speed_Hz: float | None) -> float:
        """Set the brake for torque and speed; return how long it must lead the torque (s)."""
        s = self._setpoint
        if speed_Hz is None or torque_Nm == 0.0:
            return 0.0
        before, s.brake = s.brake, self._servo.excitation(torque_Nm, speed_Hz)
        return self._servo.lead_s(before, s.brake)


def _check_signs(torque_Nm: float, speed_Hz: float) -> None:
    """Refuse a speed that a brake cannot hold against a torque. Raises PlanError."""
    if speed_Hz == 0.0:
        raise PlanError("0 Hz: the brake can hold a speed above 0 only")
    if torque_Nm * speed_Hz < 0.0:
        raise PlanError(
            f"{torque_Nm:g} Nm turns the rotor the other way than {speed_Hz:g} Hz: "
            "a brake cannot drive"
        )
