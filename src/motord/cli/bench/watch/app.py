"""The screen on a terminal: draws what changed, passes the keys on."""

import math

from textual.app import App, ComposeResult
from textual.events import Key, Paste

from motord.cli.bench.watch import keys
from motord.cli.bench.watch.controls import Controls
from motord.cli.bench.watch.feed import Feed
from motord.cli.bench.watch.glyphs import Glyphs
from motord.cli.bench.watch.operator_session import BEAT_S, OperatorSession, in_thread
from motord.cli.bench.watch.screen_lines import ScreenLines
from motord.cli.bench.watch.snapshot import Snapshot

DRAW_S = 0.2


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
