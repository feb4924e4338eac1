"""Where requests arrive: each goes to its handler; those that take time wait here for their end.

A handler answers at once, refuses, or returns a `Wait`: a condition on the bench that is looked at
in every step until it holds, becomes impossible or takes too long. Every call gets an answer, also
one over which a handler fails by an error in the program: it must not take the supervisor along.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from motord.api.descriptions import trip_words
from motord.api.errors import RpcError
from motord.api.requests import RpcRequest
from motord.schema import State
from motord.service.bench.bench import Bench
from motord.service.rpc.calls import Answer, Call


@dataclass
class Wait:
    """What a call waits for: `check` returns the answer, None for not yet, or raises RpcError.

    After `timeout_s` it is refused with the words of `too_late`.
    """

    check: Callable[[], Answer | None]
    timeout_s: float
    too_late: Callable[[], str]


Handler = Callable[[Call, int], Answer | Wait]
"""Carries out a call at a monotonic time in ns. Raises RpcError."""

_Model = TypeVar("_Model", bound=RpcRequest)


def expect(model: type[_Model], call: Call) -> _Model:
    """Return the request of a call as what the table of requests says it is."""
    if not isinstance(call.request, model):
        raise TypeError(f"{type(call.request).__name__} where {model.__name__} belongs")
    return call.request


OnError = Callable[[str, Exception], str]
"""Makes the bench safe after an error in the program, at a place in words; returns it in a line."""


class Desk:
    """Takes calls, finds their handlers, keeps those that wait.

    `on_error` is told of every error that is no refusal.
    """

    def __init__(self, handlers: Mapping[str, Handler], on_error: OnError) -> None:
        self._handlers = handlers
        self._on_error = on_error
        self._waiting: list[tuple[Call, Wait, int]] = []

    def handle(self, call: Call, now_ns: int) -> None:
        """Carry out a call, or begin to."""
        if call.name == "stop":
            self.give_up("it was stopped")
        try:
            answer = self._handlers[call.name](call, now_ns)
        except RpcError as refusal:
            call.answer(refusal)
            return
        except Exception as error:  # whatever it is, the supervisor has to go on
            call.answer(self._failed(call, error))
            return
        if isinstance(answer, Wait):
            self._waiting.append((call, answer, now_ns + round(answer.timeout_s * 1e9)))
        else:
            call.answer(answer)

    def step(self, now_ns: int) -> None:
        """Answer the waiting calls whose time has come."""
        still = []
        for call, wait, deadline_ns in self._waiting:
            answer = self._look(call, wait, late=now_ns >= deadline_ns)
            if answer is None:
                still.append((call, wait, deadline_ns))
            else:
                call.answer(answer)
        self._waiting = still

    def give_up(self, why: str) -> None:
        """Refuse the calls that wait."""
        for call, _, _ in self._waiting:
            call.answer(RpcError("refused", f"{call.name}: {why}"))
        self._waiting = []

    def _look(self, call: Call, wait: Wait, *, late: bool) -> Answer | RpcError | None:
        try:
            answer = wait.check()
            return RpcError("timeout", wait.too_late()) if answer is None and late else answer
        except RpcError as refusal:
            return refusal
        except Exception as error:  # as in `handle`
            return self._failed(call, error)

    def _failed(self, call: Call, error: Exception) -> RpcError:
        return RpcError("internal", f"{self._on_error(f'in {call.name}', error)}; stopped")


def need_loop(bench: Bench) -> None:
    """Refuse what needs a running loop."""
    if bench.loop_starting:
        raise RpcError("refused", f"{bench.loop_fault}: it is starting; try again in a moment")
    if bench.loop_fault:
        raise RpcError("refused", f"{bench.loop_fault}; `motord reset` starts the loop again")


def need_no_plan(bench: Bench) -> None:
    """Refuse what a plan does not leave to others."""
    view = bench.plans.view
    if bench.plans.active and view is not None:
        raise RpcError(
            "plan_running",
            f"plan {view.plan} is {view.state} and sets torque and speed; abort it first",
        )


def need_no_trip(bench: Bench) -> None:
    """Refuse what a tripped bench does not do."""
    if bench.state is State.TRIPPED:
        raise RpcError("tripped", f"tripped: {bench.watch.trip_in_words()}")


def need_ready(bench: Bench) -> None:
    """Refuse what needs a bench that could be enabled now."""
    need_loop(bench)
    need_no_plan(bench)
    need_no_trip(bench)
    if bench.state is State.OFF and bench.watch.trip_bits:
        raise RpcError("refused", f"it cannot be enabled: {trip_words(bench.watch.trip_bits)}")


def need_zero_torque(bench: Bench, why: str) -> None:
    """Refuse what must not happen under torque; `why` completes "set torque_Nm = 0 first: "."""
    if bench.state is State.ENABLED and (
        bench.watch.torque_set_Nm != 0.0 or bench.setpoint.torque_Nm != 0.0
    ):
        raise RpcError("refused", f"set torque_Nm = 0 first: {why}")
