"""Manual control: torque as set, speed held by the brake if one is set."""

from motord.api.messages import SetpointView
from motord.api.requests import SetpointChange
from motord.config import Config
from motord.schema import State
from motord.sequencing.brake_servo import BrakeServo
from motord.sequencing.observation import Observation
from motord.sequencing.settings import COMPENSATE
from motord.service.setpoint import Setpoint

WATCHED = (State.READY, State.ENABLED)
"""States in which the interlocks watch the rotor's speed: in others the drive stands."""


class ManualControl:
    """The set-point of an operator. A brake that has to rise leads the torque, as in a plan."""

    def __init__(self, config: Config, setpoint: Setpoint) -> None:
        self._config = config
        self._setpoint = setpoint
        self._servo = BrakeServo(config.brake)
        self._torque_Nm = 0.0
        self._lead_s = 0.0
        self._lead_from_ns: int | None = None  # Unix ns of the first update after `set`
        self._when_enabled: SetpointChange | None = None

    @property
    def waits_for_enabled(self) -> bool:
        """True while a change waits for the bench to be enabled."""
        return self._when_enabled is not None

    @property
    def wants_power(self) -> bool:
        """True if torque or a turning drive is set, or waits for the brake or to be enabled."""
        s, later = self._setpoint, self._when_enabled
        later_power = later is not None and (later.torque_Nm or later.drive_Hz)
        return bool(self._torque_Nm or s.torque_Nm or s.drive_Hz or later_power)

    def resulting(self, request: SetpointChange) -> tuple[float, float | None]:
        """Return torque (Nm) and speed (Hz, None: not held) as they would be with `request`."""
        torque_Nm = self._torque_Nm if request.torque_Nm is None else request.torque_Nm
        speed_Hz = self._setpoint.speed_Hz if request.brake is None else None
        return torque_Nm, speed_Hz if request.speed_Hz is None else request.speed_Hz

    def set(self, request: SetpointChange, state: State) -> None:
        """Apply a validated change, or keep it until the bench is enabled."""
        if request.enable and state is not State.ENABLED:
            self._when_enabled = request
        else:
            self._apply(request)

    def update(self, seen: Observation) -> None:
        """Set the torque once the brake has risen, then servo the brake to the speed."""
        s = self._setpoint
        if seen.state is not State.ENABLED:
            return
        if self._when_enabled is not None:
            request, self._when_enabled = self._when_enabled, None
            self._apply(request)
        if s.torque_Nm != self._torque_Nm:
            if self._lead_from_ns is None:
                self._lead_from_ns = seen.t_ns
            if (seen.t_ns - self._lead_from_ns) * 1e-9 < self._lead_s:
                return
            s.torque_Nm = self._torque_Nm
        elif s.speed_Hz is not None and s.torque_Nm != 0.0:
            s.brake = self._servo.follow(seen, s.torque_Nm, s.speed_Hz)

    def rest(self) -> None:
        """No torque, no speed, open brake, standing drive."""
        self.drop_torque()
        self._setpoint.rest()
        self._servo.start()

    def drop_torque(self) -> None:
        """No more torque; brake and drive stay as they are."""
        self._when_enabled = None
        self._torque_Nm = self._setpoint.torque_Nm = 0.0

    def view(self) -> SetpointView:
        """Return the set-point, with the torque that it is on its way to."""
        return self._setpoint.view(torque_target_Nm=self._torque_Nm)

    def reached_in_s(self, torque_set_Nm: float) -> float:
        """Return how long the ramp from `torque_set_Nm` takes, with the brake's lead before it."""
        waits, limits = self._setpoint.torque_Nm != self._torque_Nm, self._config.limits
        rate_Nm_per_s = (
            limits.torque_rate_Nm_per_s if self._torque_Nm else limits.ramp_down_Nm_per_s
        )
        lead_s = self._lead_s if waits else 0.0
        return lead_s + abs(self._torque_Nm - torque_set_Nm) / rate_Nm_per_s

    def _apply(self, request: SetpointChange) -> None:
        s = self._setpoint
        torque_Nm, speed_Hz = self.resulting(request)
        same = (torque_Nm, speed_Hz) == (self._torque_Nm, s.speed_Hz)
        if speed_Hz is not None and not (same and self._servo.on_speed):
            self._servo.start(speed_Hz)
        waits = s.torque_Nm != self._torque_Nm
        if request.compensate is not None:
            s.compensate = COMPENSATE[request.compensate]
        if request.drive_Hz is not None:
            s.drive_Hz = request.drive_Hz
        if request.brake is not None:
            s.brake = request.brake
        self._torque_Nm, s.speed_Hz = torque_Nm, speed_Hz
        lead_s = self._set_brake(torque_Nm, speed_Hz)
        if lead_s or speed_Hz is None or not waits:  # else it still rises, though less than before
            self._lead_s, self._lead_from_ns = lead_s, None
        if self._lead_s == 0.0 or abs(torque_Nm) < abs(s.torque_Nm):
            s.torque_Nm = torque_Nm

    def _set_brake(self, torque_Nm: float, speed_Hz: float | None) -> float:
        """Set the brake for torque and speed; return how long it must lead the torque (s).

        A torque that falls is braked until it has fallen.
        """
        s = self._setpoint
        if speed_Hz is None or torque_Nm == 0.0:
            return 0.0
        held_Nm = max(torque_Nm, s.torque_Nm, key=abs)
        before, s.brake = s.brake, self._servo.excitation(held_Nm, speed_Hz)
        return self._servo.lead_s(before, s.brake)
