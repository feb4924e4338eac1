"""Where requests arrive: each goes to its handler; those that take time wait here for their end.

A handler answers at once, refuses, or returns a `Wait`: a condition on the bench that is looked at
in every step until it holds, becomes impossible or takes too long. Every call gets an answer.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from motord.schema import State
from motord.service.bench import Bench
from motord.service.calls import Answer, Call
from motord.service.messages import Request
from motord.service.refusal import Refusal
from motord.service.words import trip_words


@dataclass
class Wait:
    """What a call waits for: `check` returns the answer, None for not yet, or raises Refusal.

    After `timeout_s` it is refused with the words of `too_late`.
    """

    check: Callable[[], Answer | None]
    timeout_s: float
    too_late: Callable[[], str]


Handler = Callable[[Call, int], Answer | Wait]
"""Carries out a call at a monotonic time in ns. Raises Refusal."""

_Model = TypeVar("_Model", bound=Request)


def expect(model: type[_Model], call: Call) -> _Model:
    """Return the request of a call as what the table of requests says it is."""
    if not isinstance(call.request, model):
        raise TypeError(f"{type(call.request).__name__} where {model.__name__} belongs")
    return call.request


class Desk:
    """Takes calls, finds their handlers, keeps those that wait."""

    def __init__(self, handlers: Mapping[str, Handler]) -> None:
        self._handlers = handlers
        self._waiting: list[tuple[Call, Wait, int]] = []

    def handle(self, call: Call, now_ns: int) -> None:
        """Carry out a call, or begin to."""
        if call.name == "stop":
            self.give_up("it was stopped")
        try:
            answer = self._handlers[call.name](call, now_ns)
        except Refusal as refusal:
            call.answer(refusal)
            return
        if isinstance(answer, Wait):
            self._waiting.append((call, answer, now_ns + round(answer.timeout_s * 1e9)))
        else:
            call.answer(answer)

    def step(self, now_ns: int) -> None:
        """Answer the waiting calls whose time has come."""
        still = []
        for call, wait, deadline_ns in self._waiting:
            answer = _look(wait, late=now_ns >= deadline_ns)
            if answer is None:
                still.append((call, wait, deadline_ns))
            else:
                call.answer(answer)
        self._waiting = still

    def give_up(self, why: str) -> None:
        """Refuse the calls that wait."""
        for call, _, _ in self._waiting:
            call.answer(Refusal("refused", f"{call.name}: {why}"))
        self._waiting = []


def _look(wait: Wait, *, late: bool) -> Answer | Refusal | None:
    try:
        answer = wait.check()
    except Refusal as refusal:
        return refusal
    return Refusal("timeout", wait.too_late()) if answer is None and late else answer


def need_loop(bench: Bench) -> None:
    """Refuse what needs a running loop."""
    if bench.loop_fault:
        raise Refusal("refused", f"{bench.loop_fault}; reset starts the loop again")


def need_no_plan(bench: Bench) -> None:
    """Refuse what a plan does not leave to others."""
    view = bench.plans.view
    if bench.plans.active and view is not None:
        raise Refusal(
            "plan_running",
            f"plan {view.plan} is {view.state} and sets torque and speed; abort it first",
        )


def need_no_trip(bench: Bench) -> None:
    """Refuse what a tripped bench does not do."""
    if bench.state is State.TRIPPED:
        raise Refusal("tripped", f"tripped: {trip_words(bench.watch.trip_bits)}; reset it first")


def need_ready(bench: Bench) -> None:
    """Refuse what needs a bench that could be enabled now."""
    need_loop(bench)
    need_no_plan(bench)
    need_no_trip(bench)
    if bench.state is State.OFF and bench.watch.trip_bits:
        raise Refusal("refused", f"it cannot be enabled: {trip_words(bench.watch.trip_bits)}")


def need_zero_torque(bench: Bench, why: str) -> None:
    """Refuse what must not happen under torque; `why` completes "set torque_Nm = 0 first: "."""
    if bench.state is State.ENABLED and (
        bench.watch.torque_set_Nm != 0.0 or bench.setpoint.torque_Nm != 0.0
    ):
        raise Refusal("refused", f"set torque_Nm = 0 first: {why}")
