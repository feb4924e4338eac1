"""Whether the recording of a plan that is over is on the disk, as the recorder says."""

from collections.abc import Callable
from pathlib import Path

from motord.recorder.launch import RecorderLink
from motord.service.recording.session import RecorderSession


class ClosingRecording:
    """The recording under way, which `end` ends once the recorder makes it.

    A recorder that died has a successor that makes it from the ring: for that, and for closing the
    file, there is `limit_s` each. Times `now_ns` are monotonic.
    """

    def __init__(
        self, recorder: RecorderSession, limit_s: float, now_ns: int, end: Callable[[], None]
    ) -> None:
        self._recorder = recorder
        self._name = recorder.task.stem.name if recorder.task is not None else ""
        self._limit_s = limit_s
        self._since_ns = now_ns
        self._end: Callable[[], None] | None = end
        self._failed = ""
        self._closer: RecorderLink | None = None

    def unrecorded(self, now_ns: int) -> str | None:
        """Return what is wrong with the recording: "" for nothing, None until it is known."""
        late = (now_ns - self._since_ns) / 1e9 > self._limit_s
        if self._end is not None:
            recorder = self._recorder
            if not (recorder.recording_task or recorder.error or late):
                return None
            if not recorder.recording_task:
                self._failed = recorder.error or "the recorder does not record"
            self._closer = recorder.link
            self._end()
            self._end, self._since_ns, late = None, now_ns, False
        if self._failed:
            return self._failed
        outcome = self._outcome()
        if outcome is None and late:
            return f"not closed within {self._limit_s:g} s: does the disk answer?"
        return outcome

    def _outcome(self) -> str | None:
        report = self._recorder.report
        for path, outcome in report.leftovers.items():
            if Path(path).name.startswith(self._name):
                return outcome
        if self._recorder.link is not self._closer:
            return "the recorder died while it closed the file"
        if not self._recorder.up or self._recorder.reported_ns <= self._since_ns:
            return None
        if not Path(report.file).name.startswith(self._name):
            return ""
        return None if report.recording else report.error
