"""RPCs of manual operation: lease, enable, disable, stop, reset, set, note."""

from collections.abc import Callable
from dataclasses import dataclass

from motord.api import requests as rpc
from motord.api.errors import RpcError
from motord.api.replies import (
    AcceptedSetpoint,
    LeaseGrant,
    LeaseTerms,
    NoteReply,
    RpcReply,
    SetpointReply,
    StateReply,
)
from motord.kernel_cache import COMPILING_S
from motord.schema import Request, State
from motord.service.bench.bench import Bench
from motord.service.bench.loop_health import LOOP_STARTS
from motord.service.rpc.dispatcher import RpcContext, Wait, handles
from motord.service.rpc.preconditions import (
    can_be_enabled,
    causes_text,
    loop_up,
    no_plan,
    no_queue,
    no_trip,
    not_ramping_down,
    validate_setpoint,
)

TICKS_S = 0.5
"""Within this time the loop has carried out a request that needs no ramp."""
LOOP_START_S = 30.0
"""A reset waits so long for a loop that it started; clients wait little longer for any reply."""
STILL_STARTING = (
    "it is still starting, and goes on: a kernel that another process compiles is waited for, "
    f"up to {COMPILING_S:g} s; `motord status` says when it is up"
)


@dataclass
class ManualOperation:
    """What an operator does.

    `restart_loop` starts the loop process if it does not run, `kill_loop` ends it at once;
    `recording` returns the file that is being recorded, "" for none.
    """

    bench: Bench
    restart_loop: Callable[[], None]
    kill_loop: Callable[[], None]
    recording: Callable[[], str] = str

    @handles(rpc.NOTE)
    def note(self, request: rpc.Note, context: RpcContext) -> NoteReply:
        """Emit a remark as an event, which is published, kept and recorded."""
        event = self.bench.events.emit("note", request.text, by=request.by)
        return NoteReply(t_ns=event.t_ns, recording=self.recording())

    @handles(rpc.LEASE_ACQUIRE)
    def acquire(self, request: rpc.LeaseAcquire, context: RpcContext) -> LeaseGrant:
        """Grant the lease."""
        grant = self.bench.lease.acquire(request.holder, context.now_ns, force=request.force)
        taken = f", taking over from {grant.took_over_from}" if grant.took_over_from else ""
        self.bench.events.emit(
            "lease",
            f"{grant.holder} is in command{taken}",
            holder=grant.holder,
            took_over_from=grant.took_over_from,
        )
        return LeaseGrant(
            token=grant.token,
            holder=grant.holder,
            took_over_from=grant.took_over_from,
            **self._terms().content(),
        )

    @handles(rpc.LEASE_RENEW)
    def renew(self, request: rpc.WithToken, context: RpcContext) -> LeaseTerms:
        """Renew the lease."""
        self.bench.lease.renew(request.token, context.now_ns)
        return self._terms()

    def _terms(self) -> LeaseTerms:
        config = self.bench.config
        return LeaseTerms(
            lease_s=config.zenoh.lease_s, renew_within_s=round(config.renew_within_s, 3)
        )

    @handles(rpc.LEASE_RELEASE)
    def release(self, request: rpc.WithToken, context: RpcContext) -> RpcReply:
        """End the lease; the bench ramps down."""
        holder = self.bench.lease.release(request.token, context.now_ns)
        self.bench.events.emit("lease", f"{holder} gave up command", holder=holder)
        self.bench.command_lost(f"{holder} gave up command")
        return RpcReply()

    @handles(rpc.ENABLE, no_queue, can_be_enabled, not_ramping_down)
    def enable(self, request: rpc.WithToken, context: RpcContext) -> Wait[StateReply]:
        """Enable at zero torque."""
        bench = self.bench
        bench.events.emit("request", f"enable, from {context.holder}")
        bench.manual.drop_torque()
        own = bench.setpoint.request(Request.ENABLE)

        def enabled() -> StateReply | None:
            self._can_still_be_enabled(own)
            return self._state() if bench.state is State.ENABLED else None

        return Wait(enabled, self._enable_s, lambda: self._not_enabled(own))

    @handles(rpc.DISABLE)
    def disable(self, request: rpc.WithToken, context: RpcContext) -> Wait[StateReply]:
        """Ramp the torque to zero, then disable; ends a plan."""
        bench = self.bench
        bench.events.emit("request", f"disable, from {context.holder}")
        if bench.plans.active:
            bench.plans.abort(f"disabled by {context.holder}")
        else:
            bench.disable()
        limits = bench.config.limits
        return Wait(
            lambda: None if bench.state is State.ENABLED else self._state(),
            2 * TICKS_S + limits.torque_Nm / limits.ramp_down_Nm_per_s,
            lambda: f"still {bench.state.name}: the torque did not ramp down; use stop",
        )

    @handles(rpc.STOP)
    def stop(self, request: rpc.StopNow, context: RpcContext) -> Wait[StateReply]:
        """Zero current now, OFF; from anyone."""
        by, bench = request.by or "somebody", self.bench
        bench.events.emit("request", f"stop, from {by}")
        bench.stop(f"stopped by {by}")
        return Wait(
            lambda: None if bench.state in (State.ENABLED, State.READY) else self._state(),
            TICKS_S,
            lambda: f"still {bench.state.name}: is the loop alive?",
        )

    @handles(rpc.RESET, no_plan)
    def reset(self, request: rpc.WithToken, context: RpcContext) -> Wait[StateReply]:
        """Leave TRIPPED if no cause is left; start the loop anew if it has ended or hangs."""
        bench = self.bench
        bench.events.emit("request", f"reset, from {context.holder}")
        if bench.loop.stalled:
            self.kill_loop()
        if bench.loop.stalled or bench.loop.fault:
            return Wait(self._new_loop(), LOOP_START_S, self._no_new_loop)
        if bench.state is State.TRIPPED:
            bench.setpoint.request(Request.RESET)
        return Wait(
            lambda: None if bench.state is State.TRIPPED else self._state(),
            TICKS_S,
            lambda: f"a cause is still there: {causes_text(bench)}",
        )

    @handles(rpc.SET, loop_up, no_plan, no_queue, no_trip, not_ramping_down)
    def set_point(
        self, request: rpc.SetpointChange, context: RpcContext
    ) -> SetpointReply | Wait[SetpointReply]:
        """Change the set-point; validated as a whole before anything is enabled or set."""
        bench = self.bench
        if request.enable:
            can_be_enabled(bench)
        validate_setpoint(bench, request)
        bench.manual.set(request, bench.state)
        if not request.enable:
            return self._setpoint()
        bench.events.emit("request", f"enable, from {context.holder}")
        own = bench.setpoint.request(Request.ENABLE)

        def enabled_and_set() -> SetpointReply | None:
            self._can_still_be_enabled(own)
            if bench.manual.waits_for_enabled:
                return None
            if bench.state is not State.ENABLED:
                self._withdraw(own)
                why = "not enabled: something came between, see `motord events`"
                raise RpcError("refused", why)
            return self._setpoint()

        return Wait(enabled_and_set, self._enable_s, lambda: self._not_enabled(own))

    def _can_still_be_enabled(self, own: int) -> None:
        """Raise RpcError, with nothing left of request `own`, if the loop is gone or tripped."""
        try:
            loop_up(self.bench)
            no_trip(self.bench)
        except RpcError:
            self.bench.manual.rest()
            self._withdraw(own)
            raise

    def _withdraw(self, own: int) -> None:
        """Let a loop that goes on not carry out request `own`; not if another came after it."""
        if self.bench.setpoint.requested == own:
            self.bench.disable()

    def _new_loop(self) -> Callable[[], StateReply | None]:
        """Return what starts a loop once there is none, unless one starts, and waits for it."""
        bench = self.bench
        started = bench.loop.starting

        def new_loop() -> StateReply | None:
            nonlocal started
            if not started and bench.loop.fault and not bench.loop.stalled:
                started = True
                bench.loop_starts()
                self.restart_loop()
            if not started or bench.loop.starting:
                return None
            if bench.loop.fault:
                raise RpcError("failed", bench.loop.fault)
            return self._state()

        return new_loop

    def _no_new_loop(self) -> str:
        bench = self.bench
        return f"{LOOP_STARTS}: {STILL_STARTING}" if bench.loop.starting else bench.fault

    def _not_enabled(self, own: int) -> str:
        self._withdraw(own)
        return f"not enabled, still {self.bench.state.name}"

    @property
    def _enable_s(self) -> float:
        return self.bench.config.loop.enable_timeout_s + 2 * TICKS_S

    def _state(self) -> StateReply:
        return StateReply(state=self.bench.state.name)

    def _setpoint(self) -> SetpointReply:
        bench = self.bench
        return SetpointReply(
            state=bench.state.name,
            setpoint=AcceptedSetpoint(**vars(bench.setpoint_view())),
            reached_in_s=round(bench.manual.reached_in_s(bench.monitor.torque_set_Nm), 3),
        )
