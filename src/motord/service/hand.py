"""Operation by hand: torque as set, speed held by the brake if one is set."""

from motord.config import Config
from motord.plans.brake_servo import BrakeServo, brake_torque_Nm
from motord.plans.limits import SPEED_MARGIN
from motord.plans.observation import Observation
from motord.plans.settings import COMPENSATE
from motord.plans.take_point import BRAKE_LEAD_TIME_CONSTANTS
from motord.schema import State
from motord.service.messages import Set
from motord.service.refusal import Refusal
from motord.service.setpoint import RAD_PER_TURN, Setpoint


class Hand:
    """What an operator has set. A brake that has to rise leads the torque, as in a plan."""

    def __init__(self, config: Config, setpoint: Setpoint) -> None:
        self._config = config
        self._setpoint = setpoint
        self._servo = BrakeServo(config.brake)
        self._torque_Nm = 0.0
        self._lead_s = 0.0
        self._lead_from_ns: int | None = None  # Unix ns of the first look after `set`

    def set(self, asked: Set, state: State) -> None:
        """Take over what `asked` holds. Raises Refusal if the bench cannot or may not do it."""
        s = self._setpoint
        torque_Nm = self._torque_Nm if asked.torque_Nm is None else asked.torque_Nm
        speed_Hz = s.speed_Hz if asked.brake is None else None
        speed_Hz = speed_Hz if asked.speed_Hz is None else asked.speed_Hz
        self._check(asked, state, torque_Nm, speed_Hz)
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

    def look(self, seen: Observation) -> None:
        """Go on: torque once the brake is there, then the brake until the speed is right."""
        s = self._setpoint
        if seen.state is not State.ENABLED:
            return
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
        self._torque_Nm = 0.0
        self._setpoint.rest()
        self._servo.drop_unproven()

    def drop_torque(self) -> None:
        """No more torque; brake and drive stay as they are."""
        self._torque_Nm = self._setpoint.torque_Nm = 0.0

    def _bring_brake(self, torque_Nm: float, speed_Hz: float | None) -> float:
        """Set the brake for torque and speed; return how long it must lead the torque (s)."""
        s = self._setpoint
        if speed_Hz is None or torque_Nm == 0.0:
            return 0.0
        before, s.brake = s.brake, self._servo.excitation(torque_Nm, speed_Hz)
        rising = s.brake > before + 0.01
        return (
            BRAKE_LEAD_TIME_CONSTANTS * self._config.brake.excitation_time_constant_s
            if rising
            else 0.0
        )

    def _check(self, asked: Set, state: State, torque_Nm: float, speed_Hz: float | None) -> None:
        limits = self._config.limits
        if asked.torque_Nm and state is not State.ENABLED:
            raise Refusal("refused", f"the bench is {state.name}: enable it first")
        if abs(torque_Nm) > limits.torque_Nm:
            raise Refusal(
                "refused", f"{torque_Nm:g} Nm is above [limits] torque_Nm = {limits.torque_Nm:g}"
            )
        if asked.drive_Hz is not None:
            fastest_Hz = self._config.drive.speed_max_rad_s / RAD_PER_TURN
            if abs(asked.drive_Hz) > fastest_Hz:
                raise Refusal(
                    "refused",
                    f"{asked.drive_Hz:g} Hz is above [drive] speed_max_rad_s ({fastest_Hz:.3g} Hz)",
                )
        if speed_Hz is not None:
            self._check_speed(torque_Nm, speed_Hz)

    def _check_speed(self, torque_Nm: float, speed_Hz: float) -> None:
        limit_Hz = SPEED_MARGIN * self._config.limits.trip_speed_rad_s / RAD_PER_TURN
        if speed_Hz == 0.0 or abs(speed_Hz) > limit_Hz:
            raise Refusal(
                "refused",
                f"{speed_Hz:g} Hz: the brake can hold a speed above 0 and, with 20 % margin to "
                f"[limits] trip_speed_rad_s, up to {limit_Hz:.3g} Hz",
            )
        if torque_Nm * speed_Hz < 0.0:
            raise Refusal(
                "refused",
                f"{torque_Nm:g} Nm turns the rotor the other way than {speed_Hz:g} Hz: "
                "a brake cannot drive",
            )
        most_Nm = abs(brake_torque_Nm(self._config.brake, 1.0, speed_Hz * RAD_PER_TURN))
        if abs(torque_Nm) > most_Nm:
            raise Refusal(
                "refused",
                f"the brake holds at most {most_Nm:.3g} Nm at {speed_Hz:g} Hz "
                f"([brake] torque_max_Nm, critical_speed_rad_s); {torque_Nm:g} asked",
            )
