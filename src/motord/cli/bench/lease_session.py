"""Command over a bench from the command line.

The first command that needs it takes the lease, shares its token with this user's other commands
and renews it for as long as it runs; commands started meanwhile in other terminals use that token
and end at once. When the one that holds the lease ends, by whatever signal, the bench ramps down
and is disabled.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING, TypeVar

from motord.cli.bench.shared_token import shared, tokens
from motord.cli.connection_options import Connection, print_answer
from motord.cli.console import fail, remark
from motord.process.interrupts import AGAIN
from motord.process.signal_handlers import INTERRUPTS, handled

if TYPE_CHECKING:
    from motord.api.messages import BenchState
    from motord.api.replies import RpcReply, StateReply
    from motord.client import Client, Commander, Lease

_Reply = TypeVar("_Reply", bound="RpcReply")
LOOK_S = 0.2
_RANK = {"TRIPPED": -1, "OFF": 0, "READY": 1, "ENABLED": 2}


@dataclass(frozen=True)
class LeaseSession:
    """What to command with, and the lease if this process is the one that holds it."""

    commander: "Commander"
    lease: "Lease | None"


@contextmanager
def in_command(client: "Client", *, force: bool = False) -> "Iterator[LeaseSession]":
    """Be in command: with the lease that another command holds, else with one of its own.

    The first of Ctrl-C, SIGTERM and SIGHUP raises KeyboardInterrupt; the lease is given back then,
    too, and no further signal keeps it from that.
    """
    from motord.client import Commander

    with interrupted_once() as hold_off:
        token = None if force else token_in_force(client)
        if token is not None:
            commander = Commander(client, token)
            with _ending_its_plan(client, commander):
                yield LeaseSession(commander, None)
            return
        lease = client.lease(force=force)
        try:
            lease.acquire()
            with shared(client.bench, lease.token):
                yield LeaseSession(lease, lease)
        finally:
            hold_off()
            if lease.token:
                lease.release()


@contextmanager
def _ending_its_plan(client: "Client", commander: "Commander") -> Iterator[None]:
    """Abort a plan that has begun in the block if that is interrupted.

    A lease of one's own ends it when it is given back; that of another command would not.
    """
    from motord.client import ClientError

    before = _run_under_way(client)
    try:
        yield
    except KeyboardInterrupt:
        if _run_under_way(client) not in (None, before):
            with suppress(ClientError):  # it may have ended meanwhile
                commander.abort_plan()
        raise


def _run_under_way(client: "Client") -> str | None:
    from motord.client import ClientError

    with suppress(ClientError):
        view = client.plan()
        return None if view is None or view.over else view.run_id
    return None


@contextmanager
def interrupted_once() -> Iterator[Callable[[], None]]:
    """Let the first of the signals raise KeyboardInterrupt in the block.

    Later ones do not disturb the clearing up, nor does any after a call of what is yielded. Those
    that are ignored stay so (nohup). One that was lost is raised again.
    """
    raised = held_off = False

    def hold_off() -> None:
        nonlocal held_off
        held_off = True

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal raised
        if not held_off and (not raised or number == AGAIN):
            raised = True
            raise KeyboardInterrupt

    is_main = threading.current_thread() is threading.main_thread()
    numbers = (*INTERRUPTS, AGAIN) if is_main else ()
    taken = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    with handled(taken, interrupt):
        yield hold_off


def command(
    ask: "Callable[[Commander], _Reply]",
    connection: Connection,
    text: "Callable[[_Reply], str]",
    *,
    force: bool,
    as_json: bool,
) -> None:
    """Ask something that needs the lease and nothing else; print the answer, JSON or `text`."""
    with connection.connect() as client, in_command(client, force=force) as session:
        answer = ask(session.commander)
        print_answer(answer.content(), text(answer), as_json)


def token_in_force(client: "Client") -> str | None:
    """Return the token of a command that runs and holds the lease now, if there is one."""
    from motord.api.requests import LEASE_RENEW
    from motord.client import ClientError

    for token in tokens(client.bench):
        with suppress(ClientError):
            client.call(LEASE_RENEW, token=token)
            return token
    return None


def announce(state: str, for_s: float | None) -> None:
    """Say on stderr that this command stays in command of a bench in `state`, and what then."""
    until = f"for {for_s:g} s" if for_s is not None else "until Ctrl-C"
    then = "the bench ramps down and is disabled" if state == "ENABLED" else "brake and drive rest"
    remark(f"in command {until}; then {then}")


def hold(client: "Client", lease: "Lease", answer: "StateReply", for_s: float | None) -> None:
    """Stay in command until interrupted or for `for_s`; what was set lasts as long.

    Fails if the bench falls back from what `answer` (to `enable` or `set`) says, or from a higher
    state that it reaches meanwhile.
    """
    from motord.api.replies import SetpointReply

    s = answer.setpoint if isinstance(answer, SetpointReply) else None
    moved = s is not None and bool(s.brake or s.drive_Hz)
    watched = _Watched(_RANK[answer.state], moved, client.state().t_ns)
    end_s = None if for_s is None else time.monotonic() + for_s
    with suppress(KeyboardInterrupt):
        while (left_s := LOOK_S if end_s is None else end_s - time.monotonic()) > 0:
            if lease.lost.wait(min(left_s, LOOK_S)):
                fail(f"no longer in command: {lease.why}")
            if why := watched.over(client.state()):
                fail(why)


@dataclass
class _Watched:
    """The highest state that a bench was seen in, to find out when it falls back from it.

    States up to `read_ns` (Unix) may date from before the answer to the command.
    """

    rank: int
    moved: bool
    read_ns: int

    def over(self, state: "BenchState") -> str:
        """Return why there is nothing left to hold, "" if there is."""
        if state.t_ns <= self.read_ns:
            return ""
        rank, s = _RANK[state.state], state.setpoint
        moves = bool(s.drive_Hz or s.brake or s.target_Nm)
        self.rank, before = max(self.rank, rank), self.rank
        self.moved, moved = self.moved or moves, self.moved
        if rank < before or rank == _RANK["TRIPPED"] or (state.state == "OFF" and state.fault):
            why = state.trip.to_text() if state.trip is not None else state.fault
            return f"the bench is {state.state}" + (f": {why}" if why else "")
        if moved and not moves and state.state != "ENABLED":
            return f"the bench is {state.state}, and what was set is undone: see `motord events`"
        return ""
