"""Preconditions on the bench, for `dispatcher.handles`, and the validation of a manual set-point.

Each raises RpcError unless it is met.
"""

from motord.api.descriptions import trip_text
from motord.api.errors import Code, RpcError
from motord.api.requests import SetpointChange
from motord.schema import Request, State
from motord.sequencing import Plan
from motord.sequencing.limits import (
    check_brake,
    check_drive,
    check_speed,
    check_torque,
    check_torque_changes,
)
from motord.sequencing.settings import PlanError
from motord.service.bench.bench import Bench
from motord.service.bench.loop_health import STALLED_NS
from motord.service.bench.manual_control import WATCHED
from motord.service.bench.tick_monitor import values_text
from motord.service.rpc.dispatcher import NotYetError


def loop_up(bench: Bench) -> None:
    """The loop runs; NotYetError: its first tick has not been read.

    What was asked before that tick the loop takes for a request to the loop before it.
    """
    if bench.loop.starting:
        raise RpcError("refused", f"{bench.loop.fault}: it is starting; try again in a moment")
    if remedy := bench.loop.remedy:
        raise RpcError("refused", f"{bench.fault}; {remedy}")
    if bench.monitor.last is None:
        why = "the loop has published no tick yet; try again in a moment"
        raise NotYetError("refused", why, 2e-9 * STALLED_NS)


def no_plan(bench: Bench) -> None:
    """No plan is under way; NotYetError: one ends."""
    view = bench.plans.view
    if bench.plans.active and view is not None:
        if view.state == "ending":
            raise _ramps_still(bench, f"plan {view.plan} still ramps down", "plan_running")
        raise RpcError(
            "plan_running",
            f"plan {view.plan} is {view.state} and sets torque and speed; abort it first",
        )


def recording_closed(bench: Bench) -> None:
    """No recording of a plan that has ended is being closed; NotYetError: one is."""
    view = bench.plans.view
    if bench.plans.closing and view is not None:
        what = f"plan {view.plan} has ended, and its recording is still being closed"
        raise _not_yet(bench, f"{what}; try again in a moment", "plan_running")


def no_queue(bench: Bench) -> None:
    """The queue of plans does not begin plans by itself."""
    if bench.queue.active:
        why = f"the queue of plans is {bench.queue.state}; `motord queue pause` first"
        raise RpcError("plan_running", why)


def plan_active(bench: Bench) -> None:
    """A plan is under way, or ends."""
    if bench.plans.concluded:
        raise RpcError("refused", "no plan is under way")


def plan_goes_on(bench: Bench) -> None:
    """A plan is under way and does not end yet."""
    plan_active(bench)
    view = bench.plans.view
    if view is not None and view.state == "ending":
        raise RpcError("refused", f"plan {view.plan} is ending; the remainder can be resumed")


def no_trip(bench: Bench) -> None:
    """The bench is not tripped."""
    if bench.state is State.TRIPPED:
        raise RpcError("tripped", f"tripped: {bench.monitor.trip_summary()}")


def can_be_enabled(bench: Bench) -> None:
    """Loop up, no plan, no trip, and no trip condition that stands against enabling."""
    loop_up(bench)
    no_plan(bench)
    no_trip(bench)
    if bench.state is State.OFF and bench.monitor.trip_bits:
        raise RpcError("refused", f"it cannot be enabled: {causes_text(bench)}")


def causes_text(bench: Bench) -> str:
    """Return the causes of the newest tick, and the values of channels that trip."""
    return trip_text(bench.monitor.trip_bits) + values_text(bench.channels.tripping)


def not_ramping_down(bench: Bench) -> None:
    """The bench is not on its way from ENABLED to READY; NotYetError: soon it is there."""
    if bench.state is State.ENABLED and bench.setpoint.newest_request is Request.DISABLE:
        raise _ramps_still(bench, "the torque still ramps to zero before it is disabled")


def zero_torque(bench: Bench, why: str) -> None:
    """No torque is set; `why` completes "set torque_Nm = 0 first: ". NotYetError: it ramps to 0."""
    if bench.state is not State.ENABLED:
        return
    if bench.setpoint_view().target_Nm != 0.0:
        raise RpcError("refused", f"set torque_Nm = 0 first: {why}")
    if bench.monitor.torque_set_Nm != 0.0:
        raise _ramps_still(bench, f"the torque still ramps to zero: {why}")


def _ramps_still(bench: Bench, what: str, code: Code = "refused") -> NotYetError:
    return _not_yet(bench, f"{what}; try again in a moment, or `motord stop`", code)


def _not_yet(bench: Bench, message: str, code: Code) -> NotYetError:
    return NotYetError(code, message, bench.config.longest_wind_down_s)


def plan_devices(bench: Bench, plan: Plan) -> None:
    """The bench has the device that a plan needs, and a calibration if it compensates."""
    if plan.needs and not bench.has(plan.needs):
        raise RpcError("refused", f"{plan.name} needs a {plan.needs}, and this bench has none")
    if plan.settings.get("compensate", "off") != "off" and not bench.calibrated:
        raise RpcError(
            "refused",
            f"{plan.name} compensates, but no calibration is installed; install one, or set "
            "compensate=off",
        )


def validate_setpoint(bench: Bench, request: SetpointChange) -> None:
    """Raise RpcError unless the bench can hold the set-point as it would be with `request`.

    The only place for it, before power is touched or anything is changed. Types and finite numbers
    are a matter of the request's model; the control kernel clamps what it gets, whoever sent it.
    """
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
        raise PlanError("0 Hz: a brake cannot hold the rotor at rest; ask for a speed")
    if torque_Nm * speed_Hz < 0.0:
        raise PlanError(
            f"{torque_Nm:g} Nm turns the rotor the other way than {speed_Hz:g} Hz: "
            "a brake cannot drive; give both the same sign"
        )
    check_brake(config, torque_Nm, speed_Hz)
