"""Whether the recording of a plan that is over is on the disk, as the recorder says."""

from pathlib import Path

from motord.service.recording.ended import failure
from motord.service.recording.session import RecorderSession


class ClosingRecording:
    """The recording `stem`, which has ended and is being closed.

    By the recorder, or by the successor of one that died: for that, and for a successor to come,
    there is `limit_s` each. `failed`: why it was not recorded when it ended, "" if it was. Times
    `now_ns` are monotonic.
    """

    def __init__(
        self, recorder: RecorderSession, stem: Path, failed: str, limit_s: float, now_ns: int
    ) -> None:
        self._recorder = recorder
        self._stem = stem
        self._outcome: str | None = failed or None
        self._limit_s = limit_s
        self._since_ns = self._begun_ns = now_ns
        self._pid = recorder.pid

    def unrecorded(self, now_ns: int, *, last: bool = False) -> str | None:
        """Return what is wrong with the recording: "" for nothing, None until it is known.

        last: there is no more to come of the recorder.
        """
        if self._outcome is None:
            self._outcome = self._reported()
        if self._outcome is None and (last or self._late(now_ns)):
            self._outcome = self._not_closed(last=last)
        return self._outcome

    def _reported(self) -> str | None:
        """Return what the recorder says of it, None if it does not."""
        if str(self._stem) in self._recorder.ended.closed:
            return ""
        new = self._recorder.reported_ns > self._since_ns
        return (failure(self._stem, self._recorder.report) or None) if new else None

    def _late(self, now_ns: int) -> bool:
        """Return whether it takes too long; a successor that has come has all of the time again."""
        recorder = self._recorder
        if recorder.up and recorder.pid != self._pid:
            self._pid, self._since_ns = recorder.pid, now_ns
        return (
            now_ns - self._since_ns > self._limit_s * 1e9
            or now_ns - self._begun_ns > 2 * self._limit_s * 1e9
        )

    def _not_closed(self, *, last: bool) -> str:
        recorder = self._recorder
        if not recorder.up and not last:
            return "the recorder does not record"
        when = "before the daemon ended" if last else f"within {self._limit_s:g} s"
        why = recorder.report.error or ("" if last else "does the disk answer?")
        return f"not closed {when}" + (f": {why}" if why else "")
