"""The dispatcher: from a queued request to its handler, its preconditions and its reply.

A handler is a method decorated with `handles`. It returns its reply, raises RpcError, or returns a
`Wait`: a condition on the bench that is evaluated in every step until it holds, becomes impossible
or times out. Every call gets a reply, also one whose handler fails by an error in the program.
"""

import queue
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from motord.api.errors import Code, RpcError
from motord.api.replies import RpcReply
from motord.api.requests import (
    DISABLE,
    PLAN_ABORT,
    STOP,
    ReplyT,
    RequestT,
    Rpc,
    RpcRequest,
    WithToken,
)
from motord.service.bench.bench import Bench

Outcome = RpcReply | RpcError
Precondition = Callable[[Bench], None]
"""Raises RpcError if the bench is not in a state for the request; see `rpc.preconditions`."""
ServiceT = TypeVar("ServiceT")


@dataclass
class Wait(Generic[ReplyT]):
    """`check` returns the reply, None for not yet, or raises RpcError.

    After `timeout_s` the call is refused with the text of `too_late`.
    """

    check: Callable[[], ReplyT | None]
    timeout_s: float
    too_late: Callable[[], str]


class NotYetError(RpcError):
    """Refused for now: the dispatcher tries again in every step, and refuses after `within_s`."""

    def __init__(self, code: Code, message: str, within_s: float) -> None:
        super().__init__(code, message)
        self.within_s = within_s


@dataclass(frozen=True)
class RpcContext:
    """What a handler gets besides the request.

    `now_ns`: monotonic. `holder`: of the lease, by the request's token; "" for an RPC without one.
    `prepared`: what another thread made of the request (`intake.Offloaded`).
    """

    now_ns: int
    holder: str = ""
    prepared: Any = None


@dataclass(frozen=True)
class Handler:
    """An RPC, the preconditions on the bench, and the function that carries it out."""

    rpc: Rpc[Any, Any]
    needs: tuple[Precondition, ...]
    function: Callable[..., RpcReply | Wait[Any]]


Method = Callable[[ServiceT, RequestT, RpcContext], ReplyT | Wait[ReplyT]]


def handles(
    rpc: Rpc[RequestT, ReplyT], *needs: Precondition
) -> Callable[[Method[ServiceT, RequestT, ReplyT]], Method[ServiceT, RequestT, ReplyT]]:
    """Register the decorated method as the handler of `rpc`.

    The lease (if the request has a token) and then `needs`, in their order, are checked before.
    """

    def register(
        method: Method[ServiceT, RequestT, ReplyT],
    ) -> Method[ServiceT, RequestT, ReplyT]:
        vars(method)["handler"] = Handler(rpc, needs, method)
        return method

    return register


def handlers_of(service: object) -> Iterator[Handler]:
    """Yield the handlers among the methods of `service`, bound to it."""
    for name, member in vars(type(service)).items():
        handler = getattr(member, "handler", None)
        if isinstance(handler, Handler):
            yield Handler(handler.rpc, handler.needs, getattr(service, name))


@dataclass(frozen=True)
class Call:
    """One request on its way to the dispatcher; the first reply counts.

    `on_reply` is called in the supervisor's thread and must not wait.
    """

    name: str
    request: RpcRequest
    prepared: Any = None
    on_reply: Callable[[Outcome], None] = lambda outcome: None
    _outcome: Future[Outcome] = field(default_factory=Future)

    def reply(self, outcome: Outcome) -> None:
        """Reply to the call, or refuse it."""
        if not self._outcome.done():
            self._outcome.set_result(outcome)
            self.on_reply(outcome)

    def wait(self, timeout_s: float) -> RpcReply:
        """Return the reply. Raises RpcError, also if none comes within `timeout_s`."""
        try:
            outcome = self._outcome.result(timeout_s)
        except TimeoutError:
            late = f"{self.name}: no answer from the supervisor in {timeout_s:g} s"
            raise RpcError("busy", late) from None
        if isinstance(outcome, RpcError):
            raise outcome
        return outcome


class CallQueue:
    """Bounded queue of calls, filled by any thread, emptied by the supervisor."""

    CAPACITY = 128

    def __init__(self) -> None:
        self._queue: queue.Queue[Call] = queue.Queue(self.CAPACITY)
        self._closed = ""

    def put(self, call: Call) -> None:
        """Queue a call without waiting. Raises RpcError if the queue is full or closed."""
        if self._closed:
            raise RpcError("refused", self._closed)
        try:
            self._queue.put_nowait(call)
        except queue.Full:
            raise RpcError("busy", f"{self.CAPACITY} requests are waiting; try again") from None

    def wait(self, timeout_s: float) -> bool:
        """Return whether a call is queued, as soon as one is, at the latest after `timeout_s`."""
        with self._queue.not_empty:
            return self._queue.not_empty.wait_for(self._queue._qsize, timeout_s) > 0

    def take(self) -> list[Call]:
        """Return the queued calls."""
        calls = []
        while True:
            try:
                calls.append(self._queue.get_nowait())
            except queue.Empty:
                return calls

    def close(self, why: str) -> None:
        """Refuse the queued calls and all later ones."""
        self._closed = why
        for call in self.take():
            call.reply(RpcError("refused", why))


class Dispatcher:
    """Carries out calls on `bench` by the handlers of `services`, and keeps those that wait.

    An error in the program, as opposed to an RpcError, stops the bench (`Bench.fault_stop`).
    """

    def __init__(self, bench: Bench, *services: object) -> None:
        self._bench = bench
        self.calls = CallQueue()
        self.handlers = {h.rpc.name: h for service in services for h in handlers_of(service)}
        self._waiting: list[tuple[Call, Wait[Any], int]] = []
        self._held: list[tuple[Call, int]] = []  # refused for now, and until when

    def take(self, now_ns: int) -> None:
        """Carry out the queued calls. `now_ns` is monotonic."""
        for call in self.calls.take():
            self.handle(call, now_ns)

    def close(self, why: str) -> None:
        """Refuse all calls from now on."""
        self.calls.close(why)
        self.give_up(why)

    def handle(self, call: Call, now_ns: int) -> None:
        """Carry out a call, or begin to; a stop refuses all that waits but what it fulfils."""
        if call.name == STOP.name:
            self.give_up("it was stopped", but=(STOP.name, DISABLE.name))
        self._begin(call, now_ns)

    def _begin(self, call: Call, now_ns: int, held_until_ns: int | None = None) -> None:
        try:
            result = self._carry_out(call, now_ns)
        except NotYetError as error:
            until_ns = held_until_ns or now_ns + round(error.within_s * 1e9)
            if now_ns < until_ns:
                self._held.append((call, until_ns))
            else:
                call.reply(error)
        except RpcError as error:
            call.reply(error)
        except Exception as error:  # whatever it is, the supervisor has to go on
            call.reply(self._failed(call, error))
        else:
            if isinstance(result, Wait):
                self._waiting.append((call, result, now_ns + round(result.timeout_s * 1e9)))
            else:
                call.reply(result)

    def step(self, now_ns: int) -> None:
        """Try the held calls again; reply to the waiting calls that are met or late."""
        held, self._held = self._held, []
        for call, until_ns in held:
            self._begin(call, now_ns, until_ns)
        waiting = []
        for call, wait, deadline_ns in self._waiting:
            outcome = self._check(call, wait, late=now_ns >= deadline_ns)
            if outcome is None:
                waiting.append((call, wait, deadline_ns))
            else:
                call.reply(outcome)
        self._waiting = waiting

    def give_up(self, why: str, but: Collection[str] = ()) -> None:
        """Refuse the waiting calls, except those of the RPCs `but`."""
        self._give_up_held(why)
        for call, _, _ in self._waiting:
            if call.name not in but:
                call.reply(RpcError("refused", f"{call.name}: {why}"))
        self._waiting = [waiting for waiting in self._waiting if waiting[0].name in but]

    def _give_up_held(self, why: str) -> None:
        """Refuse the calls that are to be tried again: what was requested last is what counts."""
        for call, _ in self._held:
            call.reply(RpcError("refused", f"{call.name}: {why}"))
        self._held = []

    def _carry_out(self, call: Call, now_ns: int) -> RpcReply | Wait[Any]:
        handler, request, holder = self.handlers[call.name], call.request, ""
        if isinstance(request, WithToken):
            holder = self._bench.lease.require(request.token, now_ns).holder
        if call.name in (DISABLE.name, PLAN_ABORT.name):
            self._give_up_held(f"{call.name} came after it")
        for need in handler.needs:
            need(self._bench)
        return handler.function(request, RpcContext(now_ns, holder, call.prepared))

    def _check(self, call: Call, wait: Wait[Any], *, late: bool) -> Outcome | None:
        try:
            reply: RpcReply | None = wait.check()
            return RpcError("timeout", wait.too_late()) if reply is None and late else reply
        except NotYetError as error:
            return error if late else None
        except RpcError as error:
            return error
        except Exception as error:  # as in `handle`
            return self._failed(call, error)

    def _failed(self, call: Call, error: Exception) -> RpcError:
        return RpcError("internal", f"{self._bench.fault_stop(f'in {call.name}', error)}; stopped")
