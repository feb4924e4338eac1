"""`motord watch`: the screen on a terminal, a line a second into a pipe, all states as JSON."""

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.bench import wording
from motord.cli.bench.overview import All, watch_all
from motord.cli.common_options import AsJson
from motord.cli.connection_options import DEFAULT, Connection
from motord.cli.console import print_line, remark
from motord.process.interrupts import ENDING
from motord.process.signal_handlers import handled
from motord.process.standard_streams import nobody_reads

if TYPE_CHECKING:
    from motord.api.messages import BenchState
    from motord.cli.bench.watch.app import WatchApp
    from motord.cli.bench.watch.operator_session import OperatorSession
    from motord.client import Client

LOOK_S = 1.0
LINE_NS = 1_000_000_000

ForS = Annotated[
    float | None, typer.Option("--for-s", min=0, metavar="S", help="End after this time.")
]
Plain = Annotated[
    bool, typer.Option("--plain", help="A line a second, as into a pipe, in place of the screen.")
]
AsciiOnly = Annotated[bool, typer.Option("--ascii", help="Draw with ASCII characters only.")]

GIVE_UP_S = 5.0
"""A program that has not ended so long after a signal hangs: the process ends without it."""


def watch(
    connection: Connection = DEFAULT,
    for_s: ForS = None,
    plain: Plain = False,
    ascii_only: AsciiOnly = False,
    all_benches: All = False,
    as_json: AsJson = False,
) -> None:
    """Watch and operate a bench on one screen of the terminal; ? shows the keys.

    Into a pipe, or on a dumb terminal, it prints a line a second; with --json every state, one line
    each. With --all it prints a line whenever a bench appears, changes, falls silent or vanishes.
    """
    if all_benches:
        watch_all(connection, for_s, as_json=as_json)
        return
    with connection.connect() as client, suppress(KeyboardInterrupt):
        if as_json:
            _each_state(client, for_s, lambda state: print_line(state.model_dump_json()))
        elif plain or not _has_screen():
            _each_state(client, for_s, Lines().show)
        else:
            _on_screen(client, for_s, ascii_only=ascii_only)


def _has_screen() -> bool:
    streams = (sys.stdin, sys.stdout, sys.stderr)  # Textual draws on stderr
    capable = os.environ.get("TERM", "dumb") not in ("dumb", "unknown", "")
    return capable and all(stream.isatty() for stream in streams)


def _each_state(
    client: "Client", for_s: float | None, show: "Callable[[BenchState], None]"
) -> None:
    """Show each state, for `for_s` from the first one on."""
    from motord.client import ClientError

    begun_s = None
    with client.subscribe_state() as states:
        while not nobody_reads():
            state = states.get(LOOK_S) or states.get(LOOK_S)  # this process may have been stopped
            if state is None:
                raise ClientError("unreachable", f"bench {client.bench} is silent: has it ended?")
            show(state)
            begun_s = begun_s or time.monotonic()
            if for_s is not None and time.monotonic() >= begun_s + for_s:
                return


class Lines:
    """Prints a state in one line, once a second and when state, plan or lease change."""

    def __init__(self) -> None:
        self._shown: tuple[object, ...] = ()

    def show(self, state: "BenchState") -> None:
        """Print a line if it is time."""
        plan = state.plan
        now = (
            state.t_ns // LINE_NS,
            state.state,
            state.lease.holder,
            (plan.plan, plan.state) if plan is not None else None,
        )
        if now != self._shown:
            self._shown = now
            print_line(in_one_line(state))


def in_one_line(state: "BenchState") -> str:
    """Return the state in one line."""
    tick, plan = state.tick, state.plan
    parts = [f"{wording.clock(state.t_ns)} {state.state}"]
    if tick is not None:
        mean = "" if state.torque_sensor.passes_mean else " without its mean"
        torque = f"torque {wording.number(tick.torque_Nm)} Nm{mean}"
        parts.append(f"{torque} (set {wording.number(tick.torque_set_Nm)} Nm)")
        parts.append(f"speed {wording.number(tick.speed_Hz)} Hz")
    parts.append(f"lease {state.lease.holder or 'nobody'}")
    if plan is not None and not plan.over:
        parts.append(f"{plan.plan} {plan.state}, {wording.plan_progress(plan)}")
    parts += wording.causes(state)
    if state.fault:
        parts.append(state.fault)
    if state.remedy:
        parts.append(state.remedy)
    return "; ".join(parts)


async def _run(app: "WatchApp", session: "OperatorSession") -> None:
    """Run the screen until it ends, or until a signal ends it."""
    import asyncio

    loop = asyncio.get_running_loop()

    def end() -> None:
        with suppress(RuntimeError):  # the loop is over: the screen has ended by itself
            loop.call_soon_threadsafe(app.exit)

    with ending_signals(end, session.give):
        await app.run_async(mouse=False)


def _on_screen(client: "Client", for_s: float | None, *, ascii_only: bool) -> None:
    import asyncio

    from motord.cli.bench.watch import glyphs
    from motord.cli.bench.watch.app import WatchApp
    from motord.cli.bench.watch.feed import Feed
    from motord.cli.bench.watch.operator_session import OperatorSession

    session = OperatorSession(client)
    drawn_with = glyphs.ASCII if ascii_only else glyphs.suitable()
    try:
        with Feed(client) as feed:
            app = WatchApp(feed, session, drawn_with, for_s)
            asyncio.run(_run(app, session))
    finally:
        held = session.holds
        session.give()
        if held:
            remark("the lease was given back: an enabled bench ramps down and is disabled")
    if app.return_code:
        raise typer.Exit(app.return_code)


@contextmanager
def ending_signals(end: Callable[[], object], give_up: Callable[[], object]) -> Iterator[None]:
    """Call `end` at a signal; if the process goes on after it, `give_up`, and end the process.

    A thread takes them from Python's wake-up descriptor. The kernel may deliver a signal to any
    thread, and the main one, where Python runs handlers, may wait for a terminal that takes no more
    output: it would never get to them.
    """
    receiving, sending = socket.socketpair()
    sending.setblocking(False)
    threading.Thread(
        target=_take, args=(receiving, end, give_up), name="motord-signals", daemon=True
    ).start()
    with sending, handled(ENDING, lambda *_: None):
        descriptor = signal.set_wakeup_fd(sending.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(descriptor)


def _take(
    receiving: socket.socket, end: Callable[[], object], give_up: Callable[[], object]
) -> None:
    with receiving:
        while received := receiving.recv(1):
            if received[0] in ENDING:
                break
        else:
            return
    end()
    time.sleep(GIVE_UP_S)
    giving_up = threading.Thread(target=give_up, daemon=True)  # it may wait for the daemon
    giving_up.start()
    giving_up.join(GIVE_UP_S)
    os._exit(128 + received[0])
