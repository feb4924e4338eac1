"""The screen on a terminal: draws what changed, does what the keys say.

What it shows as the state is always what the daemon published, never what was asked of it.
"""

import math
import threading
import time
from collections.abc import Callable
from typing import Any

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from motord.cli.bench.set_report import set_in_words
from motord.cli.bench.watch import dialogs, keys, layout
from motord.cli.bench.watch.feed import Feed
from motord.cli.bench.watch.glyphs import Glyphs
from motord.cli.bench.watch.operator_session import BEAT_S, OperatorSession
from motord.cli.bench.watch.snapshot import Snapshot
from motord.client import Client, ClientError
from motord.security.access import permits

DRAW_S = 0.2
UNANSWERED_S = 2.0
"""A stop that the daemon has not confirmed after this time is said to be unanswered."""


class ScreenLines(Widget):
    """The lines of `layout`; only cells that changed are sent to the terminal."""

    DEFAULT_CSS = "ScreenLines { width: 100%; height: 100%; }"

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._glyphs = glyphs
        self._lines: list[Text] = []

    def show(self, seen: Snapshot) -> None:
        """Draw a snapshot."""
        before, self._lines = self._lines, layout.lines(seen, *self.size, self._glyphs)
        for y, line in enumerate(self._lines):
            if y >= len(before):
                self.refresh(Region(0, y, self.size.width, 1))
            elif changed := _changed(before[y], line):
                first, last = changed
                self.refresh(Region(first, y, last - first, 1))

    def render_line(self, y: int) -> Strip:
        """Return a line of the screen."""
        line = self._lines[y] if y < len(self._lines) else Text()
        strip = Strip(line.render(self.app.console, end=""))
        return strip.adjust_cell_length(self.size.width)


def _changed(before: Text, after: Text) -> tuple[int, int] | None:
    """Return from which cell to which a line changed; all glyphs are one cell wide."""
    if before == after and before.spans == after.spans:
        return None
    one, other = before.plain, after.plain
    if before.spans != after.spans or len(one) != before.cell_len or len(other) != after.cell_len:
        return 0, max(before.cell_len, after.cell_len)
    width = max(len(one), len(other))
    one, other = one.ljust(width), other.ljust(width)
    differ = [x for x in range(width) if one[x] != other[x]]
    return (differ[0], differ[-1] + 1) if differ else None


class WatchApp(App[None]):
    """`motord watch` on a terminal."""

    ENABLE_COMMAND_PALETTE = False
    CSS = "Screen { background: ansi_default; color: ansi_default; }" + dialogs.CSS
    BINDINGS = [  # noqa: RUF012
        Binding(name, key.action, key.meaning, priority=name in ("escape", "ctrl+c"))
        if key.action != "scroll"
        else Binding(name, f"scroll('{name}')", key.meaning)
        for key in keys.KEYS
        for name in keys.pressed(key)
    ]

    def __init__(
        self, client: Client, feed: Feed, session: OperatorSession, glyphs: Glyphs,
        for_s: float | None = None,
    ) -> None:  # fmt: skip
        super().__init__(ansi_color=True)
        self._client, self._feed, self._session = client, feed, session
        self._screen_lines = ScreenLines(glyphs)
        self._for_s = for_s
        self._message, self._alarming = "", False
        self._command = ""  # that the daemon has not answered
        self._stop_asked_s: float | None = None
        self._stop_answered = False
        self._events_back = 0
        self._was_stale = False
        self._scales: tuple[float, ...] = (0.0,) * 5

    def compose(self) -> ComposeResult:
        """Return the one widget."""
        yield self._screen_lines

    def on_mount(self) -> None:
        """Begin to draw, and to show the session that the screen lives."""
        self.set_interval(BEAT_S, self._session.beat)
        self.set_interval(DRAW_S, self.draw)
        if self._for_s is not None:
            self.set_timer(self._for_s, self.exit)
        self._in_thread(self._fetch_scales)
        self.call_after_refresh(self.draw)

    def on_resize(self) -> None:
        """Draw at the new size."""
        self.call_after_refresh(self.draw)

    def draw(self) -> None:
        """Draw what is known now."""
        if why := self._session.lost():
            self._say(f"the lease is lost: {why}", alarming=True)
        seen = self._snapshot()
        if self._was_stale and not seen.stale:
            self._in_thread(self._feed.fetch_events)
        self._was_stale = seen.stale
        self._follow_stop(seen)
        self._screen_lines.show(seen)

    def _snapshot(self) -> Snapshot:
        state, age_s = self._feed.state()
        who = self._client.identity
        return Snapshot(
            bench=self._client.bench,
            endpoint=self._client.endpoint,
            state=state,
            age_s=age_s,
            events=self._feed.events(),
            columns=self._feed.columns,
            ages_s=self._feed.ages_s(),
            scales=self._scales,
            viewer=who.name if who is not None and not permits(who.role, "rpc/stop") else "",
            lease_here=self._session.holds,
            pending=self._pending(),
            message=self._message,
            alarming=self._alarming,
            events_back=self._events_back,
        )

    def _pending(self) -> str:
        if self._stop_asked_s is None:
            return f"{self._command}..." if self._command else ""
        late = time.monotonic() - self._stop_asked_s > UNANSWERED_S
        return "stop NOT confirmed" if late else "stopping..."

    def _follow_stop(self, seen: Snapshot) -> None:
        """End "stopping..." once the daemon publishes a state without torque."""
        asked_s = self._stop_asked_s
        if asked_s is not None and time.monotonic() - asked_s > UNANSWERED_S and not self._message:
            self._say(
                "the daemon has not confirmed the stop: use the emergency stop", alarming=True
            )
        if seen.state is None or seen.stale or not self._stop_answered:
            return
        if seen.state.state in ("OFF", "TRIPPED"):
            self._stop_asked_s, self._stop_answered = None, False
            self._say(f"stopped: the daemon says {seen.state.state}")

    def _fetch_scales(self) -> None:
        limits = self._feed.limits()
        of = [limits.get(name, 0.0) for name in ("torque_Nm", "trip_speed_rad_s", "current_A")]
        torque_Nm, speed_rad_s, current_A = of
        self._scales = (torque_Nm, speed_rad_s / (2.0 * math.pi), *(current_A,) * 3)

    def _say(self, text: str, *, alarming: bool = False) -> None:
        self._message, self._alarming = " ".join(text.split()), alarming

    def _in_thread(self, function: Callable[[], object]) -> None:
        threading.Thread(target=function, name="motord-watch", daemon=True).start()

    def _may(self, rpc: str) -> bool:
        """Return whether our identity may call an RPC; say so if not."""
        who = self._client.identity
        if who is None or permits(who.role, f"rpc/{rpc}"):
            return True
        self._say(
            f"{who.name} is a {who.role} and may only watch: an operator's identity may command",
            alarming=True,
        )
        return False

    def _do(self, what: str, rpc: str, call: Callable[[], str]) -> None:
        """Carry out a command in a thread and say what became of it."""
        if not self._may(rpc):
            return
        if self._command:
            self._say(f"not done: {what}; still waiting for: {self._command}", alarming=True)
            return
        self._command = what
        self._say("")
        self._in_thread(lambda: self._carry_out(what, call))

    def _carry_out(self, what: str, call: Callable[[], str]) -> None:
        try:
            said, alarming = call(), False
        except ClientError as error:
            said, alarming = self._in_words(what, error), True
        except Exception as error:  # what fails here must not end the screen
            said, alarming = f"{what}: {error}", True
        self._command = ""
        self._say(said, alarming=alarming)

    def _in_words(self, what: str, error: ClientError) -> str:
        if error.code == "lease_held":
            holder = str(error).partition(" is in command")[0]
            return f"{what}: {holder} has the lease; l takes it over"
        return f"{what}: {error}"

    def action_stop(self) -> None:
        """Stop the bench; in a thread of its own, whatever else is under way."""
        while len(self.screen_stack) > 1:
            self.pop_screen()
        if not self._may("stop"):
            return
        self._stop_asked_s, self._stop_answered = time.monotonic(), False
        self._say("")
        self._in_thread(self._stop)
        self.draw()

    def _stop(self) -> None:
        try:
            self._session.stop()
        except ClientError as error:
            self._say(f"stop FAILED: {error}; use the emergency stop", alarming=True)
            return
        self._stop_answered = True

    def action_pause(self) -> None:
        """Pause or resume the plan."""
        state, _ = self._feed.state()
        plan = state.plan if state is not None else None
        if plan is None or plan.over:
            self._say("no plan is under way: `motord plan start NAME` starts one")
        elif plan.state in ("paused", "pausing"):
            self._do("resume", "plan/resume", lambda: self._plan("plan/resume"))
        else:
            self._do("pause", "plan/pause", lambda: self._plan("plan/pause"))

    def _plan(self, rpc: str) -> str:
        reply = self._session.command(rpc)
        return f"{reply['plan']}: {reply['state']}"

    def action_abort(self) -> None:
        """Abort the plan, once that is confirmed."""
        state, _ = self._feed.state()
        if state is None or state.plan is None or state.plan.over:
            self._say("no plan is under way")
            return
        self._ask(
            f"Abort {state.plan.plan}? The bench ramps down and is disabled.",
            lambda: self._do("abort", "plan/abort", lambda: self._plan("plan/abort")),
        )

    def action_note(self) -> None:
        """Ask for a note."""
        if self._may("note"):
            self.push_screen(dialogs.Entry("Note:", max_length=1000), self._note)

    def _note(self, text: str | None) -> None:
        if text:
            self._do("note", "note", lambda: self._noted(self._session.note(text)))

    def _noted(self, reply: dict[str, Any]) -> str:
        return f"noted in {reply['recording'] or 'the events alone: nothing is being recorded'}"

    def action_reset(self) -> None:
        """Leave a trip."""
        self._do("reset", "reset", lambda: f"reset: {self._session.command('reset')['state']}")

    def action_enable(self) -> None:
        """Enable at zero torque."""
        self._do("enable", "enable", lambda: self._state_after("enable", keep=True))

    def action_disable(self) -> None:
        """Ramp down and disable."""
        self._do("disable", "disable", lambda: self._state_after("disable"))

    def _state_after(self, rpc: str, *, keep: bool = False) -> str:
        return f"{rpc}: {self._session.command(rpc, keep=keep)['state']}"

    def action_torque(self) -> None:
        """Ask for the torque."""
        if self._may("set"):
            self.push_screen(
                dialogs.Entry("Torque in Nm:", ("s", "S", "space"), 16), self._set_torque
            )

    def _set_torque(self, text: str | None) -> None:
        if not text:
            return
        try:
            torque_Nm = float(text.replace(",", "."))
        except ValueError:
            self._say(f"'{text}' is no torque in Nm: nothing is set", alarming=True)
            return
        self._do(
            f"set {torque_Nm:g} Nm",
            "set",
            lambda: set_in_words(self._session.command("set", keep=True, torque_Nm=torque_Nm)),
        )

    def action_lease(self) -> None:
        """Take the lease, ask before taking it over; or give it back."""
        state, _ = self._feed.state()
        holder = state.lease.holder if state is not None else None
        if self._session.holds:
            if state is not None and state.state == "ENABLED":
                self._ask("Give the lease back? The bench ramps down and is disabled.", self._give)
            else:
                self._give()
        elif holder:
            self._ask(f"{holder} has the lease. Take it over?", lambda: self._take(force=True))
        else:
            self._take(force=False)

    def _take(self, *, force: bool) -> None:
        def take() -> str:
            self._session.take(force=force)
            return "the lease is held here"

        self._do("lease", "lease/acquire", take)

    def _give(self) -> None:
        def give() -> str:
            self._session.give()
            return "the lease was given back"

        self._do("give the lease back", "lease/release", give)

    def action_scroll(self, key: str) -> None:
        """Show older or newer events."""
        step = {"up": 1, "down": -1}.get(key, -len(self._feed.events()))
        self._events_back = min(max(self._events_back + step, 0), len(self._feed.events()))
        self.draw()

    def action_help(self) -> None:
        """Show the keys."""
        self.push_screen(dialogs.Help())

    async def action_quit(self) -> None:
        """End; ask first if that ramps the bench down."""
        state, _ = self._feed.state()
        if self._session.holds and state is not None and state.state == "ENABLED":
            self._ask("The lease is held here: the bench ramps down. Quit?", self.exit)
        else:
            self.exit()

    def _ask(self, question: str, then: Callable[[], object]) -> None:
        def answered(yes: bool | None) -> None:
            if yes:
                then()

        self.push_screen(dialogs.Confirmation(question), answered)
