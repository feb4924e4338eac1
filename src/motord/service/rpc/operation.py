"""RPCs of operation by hand: lease, enable, disable, stop, reset, set."""

from collections.abc import Callable

from motord.api.descriptions import trip_words
from motord.api.errors import RpcError
from motord.api.requests import LeaseAcquire, Set, Stop, WithToken
from motord.schema import Request as Ask
from motord.schema import State
from motord.service.bench.bench import Bench
from motord.service.rpc.calls import Answer, Call
from motord.service.rpc.dispatcher import (
    Handler,
    Wait,
    expect,
    need_loop,
    need_no_plan,
    need_no_trip,
    need_ready,
)

SOON_S = 0.5
"""Within this time the loop has carried out what needs no ramp."""
LOOP_START_S = 30.0
"""Within this time a loop is up: it may have to compile its kernel and open devices."""


class Operate:
    """What an operator does; `restart_loop` starts the loop process if it does not run."""

    def __init__(self, bench: Bench, restart_loop: Callable[[], None]) -> None:
        self._bench = bench
        self._restart_loop = restart_loop
        self.handlers: dict[str, Handler] = {
            "lease/acquire": self._acquire,
            "lease/renew": self._renew,
            "lease/release": self._release,
            "enable": self._enable,
            "disable": self._disable,
            "stop": self._stop,
            "reset": self._reset,
            "set": self._set,
        }

    def _acquire(self, call: Call, now_ns: int) -> Answer:
        asked, lease = expect(LeaseAcquire, call), self._bench.lease
        grant = lease.acquire(asked.holder, now_ns, force=asked.force)
        taken = f", taking over from {grant.took_over_from}" if grant.took_over_from else ""
        self._bench.events.emit(
            "lease",
            f"{grant.holder} is in command{taken}",
            holder=grant.holder,
            took_over_from=grant.took_over_from,
        )
        return {
            "token": grant.token,
            "holder": grant.holder,
            **self._terms(),
            "took_over_from": grant.took_over_from,
        }

    def _renew(self, call: Call, now_ns: int) -> Answer:
        lease = self._bench.lease
        lease.renew(expect(WithToken, call).token, now_ns)
        return self._terms()

    def _terms(self) -> Answer:
        """Return for how long a lease lasts, and within what time it has to be renewed."""
        config = self._bench.config
        return {"lease_s": config.zenoh.lease_s, "renew_within_s": round(config.renew_within_s, 3)}

    def _release(self, call: Call, now_ns: int) -> Answer:
        who = self._bench.lease.release(expect(WithToken, call).token, now_ns)
        self._bench.events.emit("lease", f"{who} gave up command", holder=who)
        self._bench.nobody_commands(f"{who} gave up command")
        return {}

    def _commander(self, call: Call, now_ns: int) -> str:
        token = expect(WithToken, call).token
        return self._bench.lease.require(token, now_ns).holder

    def _in_state(self) -> Answer:
        return {"state": self._bench.state.name}

    def _enable(self, call: Call, now_ns: int) -> Answer | Wait:
        who, bench = self._commander(call, now_ns), self._bench
        need_ready(bench)
        bench.events.emit("request", f"enable, from {who}")
        bench.hand.drop_torque()
        bench.setpoint.request(Ask.ENABLE)

        def enabled() -> Answer | None:
            need_loop(bench)
            need_no_trip(bench)
            return self._in_state() if bench.state is State.ENABLED else None

        return Wait(enabled, self._enable_s, self._not_enabled)

    @property
    def _enable_s(self) -> float:
        return self._bench.config.loop.enable_timeout_s + 2 * SOON_S

    def _disable(self, call: Call, now_ns: int) -> Answer | Wait:
        who, bench = self._commander(call, now_ns), self._bench
        bench.events.emit("request", f"disable, from {who}")
        if bench.plans.active:
            bench.plans.abort(f"disabled by {who}")
        else:
            bench.disable()
        limits = bench.config.limits
        return Wait(
            lambda: None if bench.state is State.ENABLED else self._in_state(),
            2 * SOON_S + limits.torque_Nm / limits.torque_rate_Nm_per_s,
            lambda: f"still {bench.state.name}: the torque did not ramp down; use stop",
        )

    def _stop(self, call: Call, now_ns: int) -> Answer | Wait:
        by, bench = expect(Stop, call).by or "somebody", self._bench
        bench.events.emit("request", f"stop, from {by}")
        bench.stop(f"stopped by {by}")
        return Wait(
            lambda: None if bench.state in (State.ENABLED, State.READY) else self._in_state(),
            SOON_S,
            lambda: f"still {bench.state.name}: is the loop alive?",
        )

    def _reset(self, call: Call, now_ns: int) -> Answer | Wait:
        who, bench = self._commander(call, now_ns), self._bench
        need_no_plan(bench)
        bench.events.emit("request", f"reset, from {who}")
        if bench.loop_fault:
            if not bench.loop_starting:
                bench.loop_starts()
                self._restart_loop()
            return Wait(self._loop_up, LOOP_START_S, lambda: bench.loop_fault)
        if bench.state is State.TRIPPED:
            bench.setpoint.request(Ask.RESET)
        return Wait(
            lambda: None if bench.state is State.TRIPPED else self._in_state(),
            SOON_S,
            lambda: f"a cause is still there: {trip_words(bench.watch.trip_bits)}",
        )

    def _loop_up(self) -> Answer | None:
        bench = self._bench
        if bench.loop_starting:
            return None
        if bench.loop_fault:
            raise RpcError("failed", bench.loop_fault)
        return self._in_state()

    def _set(self, call: Call, now_ns: int) -> Answer | Wait:
        """Carry out a set-point; all of it is checked before anything is enabled or set."""
        asked, bench = expect(Set, call), self._bench
        who = bench.lease.require(asked.token, now_ns).holder
        need_loop(bench)
        need_no_plan(bench)
        need_no_trip(bench)
        self._need_devices(asked)
        if asked.enable:
            need_ready(bench)
        bench.hand.set(asked, bench.state)
        if not asked.enable:
            return self._set_answer()
        bench.events.emit("request", f"enable, from {who}")
        bench.setpoint.request(Ask.ENABLE)
        return Wait(self._enabled_and_set, self._enable_s, self._not_enabled)

    def _enabled_and_set(self) -> Answer | None:
        bench = self._bench
        try:
            need_loop(bench)
            need_no_trip(bench)
        except RpcError:
            bench.hand.rest()
            raise
        if bench.hand.waits_for_enabled:
            return None
        if bench.state is not State.ENABLED:
            bench.disable()
            raise RpcError("refused", "not enabled: something came between, see `motord events`")
        return self._set_answer()

    def _not_enabled(self) -> str:
        self._bench.disable()
        return f"not enabled, still {self._bench.state.name}"

    def _set_answer(self) -> Answer:
        bench = self._bench
        reached_s = bench.hand.reached_in_s(bench.watch.torque_set_Nm)
        return {
            **self._in_state(),
            "setpoint": bench.setpoint_view().model_dump(),
            "reached_in_s": round(reached_s, 3),
        }

    def _need_devices(self, asked: Set) -> None:
        bench = self._bench
        if asked.torque_Nm and bench.trouble:
            raise RpcError("refused", f"no torque now: {bench.trouble}")
        if (asked.speed_Hz is not None or asked.brake is not None) and not bench.has("brake"):
            raise RpcError("refused", "this bench has no brake that the daemon could set")
        if asked.drive_Hz is not None and not bench.has("drive"):
            raise RpcError("refused", "this bench has no external drive that the daemon could set")
        if asked.compensate not in (None, "off") and not bench.calibrated:
            raise RpcError("refused", "nothing to compensate with: no calibration is installed")
