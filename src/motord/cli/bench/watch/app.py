"""The screen on a terminal: draws what changed, passes the keys on."""

import math

from rich.segment import Segment
from rich.text import Text
from textual.app import App, ComposeResult
from textual.events import Key, Paste
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from motord.cli.bench.watch import keys, layout
from motord.cli.bench.watch.controls import Controls
from motord.cli.bench.watch.feed import Feed, Snapshot
from motord.cli.bench.watch.glyphs import Glyphs
from motord.cli.bench.watch.operator_session import BEAT_S, OperatorSession, in_thread

DRAW_S = 0.2


class ScreenLines(Widget):
    """The lines of `layout`."""

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
            elif changed := changed_cells(before[y], line):
                first, last = changed
                self.refresh(Region(first, y, last - first, 1))

    def render_line(self, y: int) -> Strip:
        """Return a line of the screen."""
        line = self._lines[y] if y < len(self._lines) else Text()
        console = self.app.console
        styled = Segment.apply_style(line.render(console, end=""), console.get_style(line.style))
        return Strip(styled).adjust_cell_length(self.size.width)


def changed_cells(before: Text, after: Text) -> tuple[int, int] | None:
    """Return the first cell that changed and the one after the last, None if none did."""
    one, other = before.plain, after.plain
    same_style = before.style == after.style and before.spans == after.spans
    if same_style and one == other:
        return None
    if not same_style or len(one) != before.cell_len or len(other) != after.cell_len:
        return 0, max(before.cell_len, after.cell_len)
    width = max(len(one), len(other))
    one, other = one.ljust(width), other.ljust(width)
    differ = [x for x in range(width) if one[x] != other[x]]
    return (differ[0], differ[-1] + 1) if differ else None


class WatchApp(App[None], inherit_bindings=False):
    """`motord watch` on a terminal, for `for_s` or until it is quit."""

    ENABLE_COMMAND_PALETTE = False
    CSS = "Screen { background: ansi_default; color: ansi_default; }"

    def __init__(
        self,
        feed: Feed,
        session: OperatorSession,
        glyphs: Glyphs,
        for_s: float | None = None,
    ) -> None:
        super().__init__(ansi_color=True)
        self._feed, self._session = feed, session
        self._controls = Controls(feed, session, self.exit)
        self._screen_lines = ScreenLines(glyphs)
        self._for_s = for_s
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
        in_thread(self._fetch_scales)
        self.call_after_refresh(self.draw)

    def on_resize(self) -> None:
        """Draw at the new size."""
        self.call_after_refresh(self.draw)

    def on_key(self, event: Key) -> None:
        """Do what a key says. Keys come one after the other, also those that are typed at once."""
        event.stop()
        if self._controls.dialog is not None:
            self._controls.press(event.key, event.character)
        elif event.key in keys.ACTIONS:
            self._controls.do(keys.ACTIONS[event.key])
        self.draw()

    def on_paste(self, event: Paste) -> None:
        """Take pasted text."""
        event.stop()
        self._controls.paste(event.text)

    def draw(self) -> None:
        """Draw what is known now."""
        stale = self._feed.stale
        if self._was_stale and not stale:
            in_thread(self._feed.fetch_events)
        self._was_stale = stale
        self._controls.follow()
        self._screen_lines.show(self._snapshot())

    def _snapshot(self) -> Snapshot:
        state, age_s = self._feed.state()
        controls = self._controls
        return Snapshot(
            bench=self._session.client.bench,
            state=state,
            age_s=age_s,
            events=self._feed.events(),
            columns=self._feed.columns,
            scales=self._scales,
            viewer=controls.viewer,
            lease_here=self._session.holds,
            pending=controls.pending,
            message=controls.message,
            alarming=controls.alarming,
            events_back=controls.events_back,
            dialog=controls.dialog.lines() if controls.dialog is not None else (),
        )

    def _fetch_scales(self) -> None:
        limits = self._feed.limits()
        of = [limits.get(name, 0.0) for name in ("torque_Nm", "trip_speed_rad_s", "current_A")]
        torque_Nm, speed_rad_s, current_A = of
        self._scales = (torque_Nm, speed_rad_s / (2.0 * math.pi), *(current_A,) * 3)
