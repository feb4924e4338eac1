"""Validation of a manual set-point, as a whole, before power is touched or anything is changed.

The only place for it. Types and finite numbers are a matter of the request's model, when it is
parsed; the control kernel clamps what it gets, whoever sent it.
"""

from motord.api.errors import RpcError
from motord.api.requests import SetpointChange
from motord.schema import State
from motord.sequencing.limits import (
    check_brake,
    check_drive,
    check_speed,
    check_torque,
    check_torque_changes,
)
from motord.sequencing.settings import PlanError
from motord.service.bench.bench import Bench
from motord.service.bench.manual_control import WATCHED


def validate_setpoint(bench: Bench, request: SetpointChange) -> None:
    """Raise RpcError unless the bench can hold the set-point as it would be with `request`."""
    _check_devices(bench, request)
    _check_state(bench, request)
    try:
        _check_limits(bench, request)
    except PlanError as error:
        raise RpcError("refused", str(error)) from None
    if request.drive_Hz and bench.state not in WATCHED and not request.enable:
        raise RpcError(
            "refused",
            f"the bench is {bench.state.name}: the rotor's speed is watched in READY and ENABLED "
            "alone; enable it first (disabled again it is READY)",
        )


def _check_devices(bench: Bench, request: SetpointChange) -> None:
    if request.torque_Nm and bench.device_fault:
        raise RpcError("refused", f"no torque now: {bench.device_fault}")
    if request.drive_Hz and bench.drive_fault:
        raise RpcError("refused", f"the drive may not turn now: {bench.drive_fault}")
    if (request.speed_Hz is not None or request.brake is not None) and not bench.has("brake"):
        raise RpcError("refused", "this bench has no brake that the daemon could set")
    if request.drive_Hz is not None and not bench.has("drive"):
        raise RpcError("refused", "this bench has no external drive that the daemon could set")
    if request.compensate not in (None, "off") and not bench.calibrated:
        raise RpcError("refused", "nothing to compensate with: no calibration is installed")


def _check_state(bench: Bench, request: SetpointChange) -> None:
    if bench.manual.waits_for_enabled:
        raise RpcError("refused", "the bench is being enabled; try again when it is")
    if request.torque_Nm and bench.state is not State.ENABLED and not request.enable:
        raise RpcError("refused", f"the bench is {bench.state.name}: enable it first")


def _check_limits(bench: Bench, request: SetpointChange) -> None:
    """Raises PlanError."""
    config = bench.config
    torque_Nm, speed_Hz = bench.manual.resulting(request)
    check_torque(config, torque_Nm)
    if torque_Nm:
        check_torque_changes(config, (bench.monitor.torque_set_Nm, torque_Nm))
    if request.drive_Hz is not None:
        check_drive(config, request.drive_Hz)
    if speed_Hz is None:
        return
    check_speed(config, speed_Hz)
    if speed_Hz == 0.0:
        raise PlanError("0 Hz: the brake can hold a speed above 0 only")
    if torque_Nm * speed_Hz < 0.0:
        raise PlanError(
            f"{torque_Nm:g} Nm turns the rotor the other way than {speed_Hz:g} Hz: "
            "a brake cannot drive"
        )
    check_brake(config, torque_Nm, speed_Hz)
