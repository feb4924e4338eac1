"""What is recorded and under which name: the supervisor's side of the recorder process.

With `[recording] auto` the bench is recorded whenever it is powered: from `BEFORE_S` before it was
enabled, out of the ring, until `AFTER_S` after it no longer is; with "always", powered or not. A
plan has a recording of its own; one of manual operation ends before it, and if the bench is still
powered a new one begins after it, so that every tick of a powered bench is in exactly one file. A
recorder that was started again resumes where the files of its predecessor end, as far back as the
ring reaches. A plan whose ticks have been in the ring alone for too long is ended.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from motord.api.messages import RecordingView
from motord.api.plan_messages import PlanView
from motord.config import ChannelConfig, Config
from motord.recorder.protocol import Mark, RecordingTask
from motord.recording.file_names import file_name, stamp
from motord.recording.metadata import describe
from motord.schema import TICK_DTYPE, State
from motord.sequencing import Plan
from motord.service.host.child_pipes import SILENCE_MAX_NS
from motord.service.host.children import Children
from motord.service.host.events import EventLog
from motord.service.recording.closing import ClosingRecording
from motord.service.recording.logs import Destination, NamedState, StateLog, TimingLog
from motord.service.recording.session import RecorderSession

BEFORE_S = 2.0
"""Ticks before the bench was enabled that belong to a recording."""
AFTER_S = 2.0
RING_PART = 0.5
"""Part of `[loop] ring_s` for which the ring alone may hold the ticks of a plan."""
SILENCE_SAID_S = 0.75 * SILENCE_MAX_NS / 1e9
"""The recorder, which reports twice a second, may be silent for so long or, if that is less, for
the same part of the ring: it is said before the recorder is ended for it."""
NO_TICKS = np.empty(0, TICK_DTYPE)


class RecordingControl:
    """Decides what the recorder records. No call but `close` waits for it.

    The loop counts its timing in the file `timing`. What `about` returns goes into the metadata of
    the next recording; `driven` says whether the drive turns the rotor; `state` is recorded
    whenever it changes; `on_plan_unrecorded` is called with the reason when a plan has to end.
    """

    def __init__(
        self,
        config: Config,
        toml: str,
        children: Children,
        events: EventLog,
        unix_ns: Callable[[], int],
        timing: Path,
        *,
        about: Callable[[], dict[str, Any]] = dict,
        driven: Callable[[], bool] = bool,
        state: Callable[[int], NamedState] | None = None,
        on_plan_unrecorded: Callable[[str], None] = lambda why: None,
    ) -> None:
        self._config = config
        self._described = describe(config, toml)  # versions of packages: it takes a while
        self._unix_ns = unix_ns
        self._now_ns = self._recorded_ns = self._powered_ns = 0
        self._plan = False
        self._plan_progress: tuple[object, ...] = ()
        self._closing: ClosingRecording | None = None
        self._enabled = self._loop_up = False
        self._ticks = NO_TICKS
        self.recorder = RecorderSession(children, events, unix_ns, config.loop.ring_s)
        self._timing = TimingLog(timing, self.recorder.event)
        self._states, self._state = StateLog(self.recorder.state), state
        self._about, self._driven, self._on_plan_unrecorded = about, driven, on_plan_unrecorded

    def loop_down(self) -> None:
        """Begin nothing new; what remains of the loop's ticks goes into the file under way."""
        self._follow_power(self._now_ns)  # it may have been powered in its last ticks alone
        self._loop_up, self.recorder.loop_over, self._ticks = False, True, NO_TICKS

    def end(self, why: str) -> None:
        """End the recording under way."""
        self._end_timing()
        self.recorder.end(why)

    @property
    def settled(self) -> bool:
        """True if the recorder is up and records what it should, or has reported why not."""
        recorder = self.recorder
        recorded = recorder.task is None or recorder.report.recording or bool(recorder.error)
        return recorder.up and recorded

    def obstacle(self) -> str:
        """Return why a plan could not be recorded now, "" if it could or need not be."""
        recorder = self.recorder
        if not self._config.recording.required:
            return ""
        if not recorder.up:
            return self._silence() or "the recorder is not up; see its events"
        return self._silence() or ("" if recorder.report.recording else recorder.report.obstacle)

    def _silence(self) -> str:
        """Return that a recorder that has sent something has not reported for long, or ""."""
        silent_s = (self._now_ns - self.recorder.reported_ns) / 1e9
        if not self.recorder.has_sent or silent_s <= min(self._unrecorded_max_s, SILENCE_SAID_S):
            return ""
        return f"the recorder has not reported for {silent_s:.0f} s: does the disk answer?"

    def take_ticks(self, block: np.ndarray) -> None:
        """Take the new ticks, shape (n,): what ends from now on ends with them."""
        self._ticks = block
        if len(block):
            self._loop_up, self.recorder.loop_over = True, False
            self._enabled = int(block["state"][-1]) == State.ENABLED
            self.recorder.newest = Mark.of_last(block)

    def step(self, now_ns: int) -> None:
        """Follow bench and recorder; `now_ns` is monotonic."""
        self._now_ns = now_ns
        self.recorder.follow_process(now_ns)
        self._follow_power(now_ns)
        self._check_plan(now_ns)
        if self.recorder.link is not None and self.recorder.task is not None:
            self._timing.step(self._unix_ns())
        self._log_state(now_ns)
        self.recorder.step(now_ns)

    def close(self) -> None:
        """End what is recorded, with what the loop has still written, and wait until it is closed.

        `unrecorded` is known then.
        """
        self.loop_down()
        self.end("the daemon shut down")
        self.recorder.await_closed()
        if self._closing is not None:
            self._closing.unrecorded(self._now_ns, last=True)

    @property
    def path(self) -> str:
        """The newest file by its present name."""
        return self.recorder.report.path

    def view(self) -> RecordingView:
        """Return what is recorded now."""
        report = self.recorder.report
        return RecordingView(
            recording=report.recording,
            path=report.path,
            final_path=report.file,
            error=self.recorder.error or self._silence(),
            obstacle=report.obstacle,
            detail=report.model_dump(include={"ticks", "bytes", "lost"}, exclude_unset=True),
        )

    def file(self) -> str:
        """Return the file that events go into now, by its final name; "" for none."""
        recorder = self.recorder
        if recorder.link is None or recorder.task is None or recorder.error:
            return ""
        begun = recorder.recording_task  # else its first report is still to come
        return recorder.report.file if begun else str(file_name(recorder.task.stem, 0))

    def about(self) -> dict[str, Any]:
        """Return the metadata of a recording that begins now."""
        return {**self._described, **self._about()}

    def plan_started(self, plan: Plan, view: PlanView, notes: str) -> str:
        """Begin the recording of a plan; returns its path."""
        described = {
            "name": plan.name,
            "settings": plan.settings,
            "points": len(plan.points),
            "started_by": view.started_by,
            "run_id": view.run_id,
            **({"continues": view.continues} if view.continues else {}),
        }
        self._plan_progress, self._closing = (), None
        self._plan, self._recorded_ns = True, self._now_ns
        first_tick = self._ticks_before(self._newest_tick, BEFORE_S)
        return self._begin(f"-{plan.name}", described, notes, first_tick, view.serial)

    def channel(self, channel: ChannelConfig, age_ns: int, content: Mapping[str, Any]) -> None:
        """Record a reading of a slow channel, taken `age_ns` ago."""
        self.recorder.channel(self._unix_ns() - age_ns, channel, content)

    def plan_point(self, point: dict[str, Any]) -> None:
        """Record an operating point."""
        self.recorder.record("operating_point", int(point["t_end_ns"]), point)

    def plan_progress(self, view: PlanView) -> None:
        """Record a plan's progress when it comes to another step."""
        progress = (view.state, view.step, view.points_done)
        if self._plan and progress != self._plan_progress:
            self._plan_progress = progress
            self.recorder.record("plan", self._unix_ns(), view.model_dump(mode="json"))

    def plan_over(self, view: PlanView) -> None:
        """End the recording of a plan, once; if the bench is still powered, another begins."""
        if not self._plan:
            return
        self._plan = False
        auto = self._config.recording.auto
        if self._loop_up and auto and (auto == "always" or self._enabled or self._driven()):
            self._powered_ns = self._now_ns
            self._begin("", {}, first_tick=self._newest_tick + 1)
        else:
            self.end(f"plan {view.plan} {view.state}")
            self._ticks = NO_TICKS  # powered ones among them belong to the plan's recording

    def plan_closing(self, view: PlanView) -> None:
        """End the recording of a plan, however it ends; `unrecorded` says what becomes of it."""
        recorder, task = self.recorder, self.recorder.task
        if self._plan and task is not None and self._config.recording.required:
            failed = "" if recorder.recording_task else recorder.error
            limit_s = self._unrecorded_max_s
            self._closing = ClosingRecording(recorder, task.stem, failed, limit_s, self._now_ns)
        self.plan_over(view)

    def unrecorded(self) -> str | None:
        """Return what is wrong with a recording that closes, "" for nothing; None: not known."""
        return self._closing.unrecorded(self._now_ns) if self._closing is not None else ""

    def _log_state(self, now_ns: int) -> None:
        if self._state is None:
            return
        task, file = self.recorder.task, self.file()
        destination = Destination(str(task.stem), file) if task is not None and file else None
        before_ns = round(BEFORE_S * 1e9)
        self._states.step(self._state(now_ns), destination, self._unix_ns(), before_ns)

    def _follow_power(self, now_ns: int) -> None:
        """Begin and end the recordings of manual operation."""
        if self._plan or not self._config.recording.auto:
            return
        block, states = self._ticks, self._ticks["state"].tolist()  # numpy is slow with an enum
        always, task = self._config.recording.auto == "always", self.recorder.task
        if always or State.ENABLED in states or self._driven():
            self._powered_ns = now_ns
            if task is None and len(block):
                powered = int(block["tick"][np.argmax(block["state"] == State.ENABLED)])
                self._begin("", {}, first_tick=self._ticks_before(powered, BEFORE_S))
        elif task is not None and now_ns - self._powered_ns >= AFTER_S * 1e9:
            self.end("the bench is not powered any more")

    @property
    def _newest_tick(self) -> int:
        newest = self.recorder.newest
        return newest.tick if newest is not None else 0

    @property
    def _unrecorded_max_s(self) -> float:
        return RING_PART * self._config.loop.ring_s

    def _ticks_before(self, tick: int, span_s: float) -> int:
        return max(0, tick - round(span_s * self._config.loop.rate_Hz))

    def _check_plan(self, now_ns: int) -> None:
        """End a plan while the ring still has what was not recorded of it."""
        if not self._plan or not self._config.recording.required:
            return
        if self.recorder.recording_task:
            self._recorded_ns = max(self._recorded_ns, self.recorder.reported_ns)
        unrecorded_s = (now_ns - self._recorded_ns) / 1e9
        if unrecorded_s > self._unrecorded_max_s:
            self._recorded_ns = now_ns  # not again with every step
            why = self.recorder.error or self._silence() or "the recorder does not record"
            self._on_plan_unrecorded(f"not recorded for {unrecorded_s:.1f} s: {why}")

    def _end_timing(self) -> None:
        """Record what the loop has counted since the last time, if something is recorded."""
        if self.recorder.task is not None:
            self._timing.end(self._unix_ns())

    def _begin(
        self,
        suffix: str,
        plan: dict[str, Any],
        notes: str = "",
        first_tick: int | None = None,
        serial: str = "",
    ) -> str:
        self._end_timing()
        self._timing.begin(self._unix_ns())
        config = self._config
        name = f"{config.bench.name}-{stamp(self._unix_ns())}{suffix}"
        stem = config.recording.directory.absolute() / name
        notes = f"{config.bench.notes}\n{notes}".strip()
        metadata = {**self.about(), "plan": plan, "notes": notes}
        if serial:
            metadata["motor"] = {**metadata["motor"], "serial": serial}
        self.recorder.begin(RecordingTask(stem, metadata, first_tick))
        return str(file_name(stem, 0))
