"""What the recording of a plan has come to when the plan is over, as the recorder reports it."""

from types import SimpleNamespace

import pytest

from motord import config
from motord.api.plan_messages import PlanView
from motord.recorder.protocol import RecorderReport
from motord.service.host.events import EventLog
from motord.service.recording.control import RecordingControl
from motord.service.recording.session import NO_REPORT

PLAN = SimpleNamespace(name="verify", settings={}, points=())
VIEW = PlanView(plan="verify", state="done", started_by="anna", run_id="1")
FULL = "cannot write it: No space left on device"


class Link:
    """A recorder that takes every command, and what it has sent."""

    def __init__(self):
        self.sent = []

    def reports(self, _now_ns):
        sent, self.sent = self.sent, []
        return sent

    def __getattr__(self, _command):
        return lambda *_, **__: None


class Closing:
    """A plan's recording, and what the recorder reports of it."""

    def __init__(self, folder, **recording):
        bench = config.load().model_copy(
            update={"recording": config.RecordingConfig(directory=folder, **recording)}
        )
        self.control = RecordingControl(
            bench, "", None, EventLog(int), lambda: 0, folder / "timing"
        )
        self.recorder = self.control.recorder
        self.recorder.link = Link()
        self.limit_s = bench.loop.ring_s / 2
        self.file = self.control.plan_started(PLAN, VIEW, "")
        self.stem = self.file.removesuffix("-000.mcap")
        self.at(0.0, recording=True, file=self.file)

    def at(self, now_s, **report):
        if report:
            self.recorder.link.sent = [RecorderReport(**report)]
            self.recorder._take_reports(self.recorder.link, round(now_s * 1e9))
        self.control._now_ns = round(now_s * 1e9)
        return self.control.unrecorded()

    def ended(self):
        self.control.plan_closing(VIEW)
        return self


def test_it_is_known_when_the_file_is_closed(tmp_path):
    closing = Closing(tmp_path).ended()
    assert closing.at(1.0) is None
    assert closing.at(2.0, recording=True, file=closing.file) is None  # sent before it was asked to
    assert closing.at(3.0, recording=False, file=closing.file, closed=[closing.stem]) == ""


def test_another_recording_that_has_begun_says_nothing_of_it(tmp_path):
    closing = Closing(tmp_path).ended()
    other = str(tmp_path / "other-000.mcap")
    report = {"recording": True, "file": other, "error": "of the other"}
    assert closing.at(2.0, **report) is None
    assert closing.at(3.0, **report, closed=[closing.stem]) == ""
    assert closing.at(4.0, **report, closed=["a later one"]) == ""


@pytest.mark.parametrize("how", ["error", "leftovers"])
def test_a_file_that_could_not_be_written_to_its_end_is_said(tmp_path, how):
    closing = Closing(tmp_path).ended()
    content = {"error": FULL} if how == "error" else {"leftovers": {f"{closing.file}.part": FULL}}
    file = closing.file if how == "error" else str(tmp_path / "other-000.mcap")
    assert closing.at(2.0, recording=how == "leftovers", file=file, **content) == FULL


def test_a_recording_that_had_ended_before_is_said_at_once(tmp_path):
    closing = Closing(tmp_path)
    closing.at(0.5, recording=False, file=closing.file, error=FULL)
    closing.recorder.error = FULL
    assert closing.ended().at(1.0) == FULL


def test_a_recorder_that_has_died_has_a_successor_that_closes_it(tmp_path):
    closing = Closing(tmp_path).ended()
    closing.recorder.report = NO_REPORT
    late_s = closing.limit_s
    assert closing.at(late_s) is None
    closing.recorder.pid = 2
    assert closing.at(late_s, recording=False) is None
    assert closing.at(late_s + 1.0) is None
    assert closing.at(late_s + 2.0, recording=False, closed=[closing.stem]) == ""


def test_a_successor_that_does_not_close_it_either_is_waited_for_as_long(tmp_path):
    closing = Closing(tmp_path).ended()
    closing.recorder.report = NO_REPORT
    assert closing.at(closing.limit_s) is None
    closing.recorder.pid = 2
    assert closing.at(closing.limit_s, recording=True, file=closing.file) is None
    assert closing.at(2 * closing.limit_s) is None
    assert "does the disk answer?" in closing.at(2 * closing.limit_s + 0.1)


def test_a_recorder_without_a_successor_has_recorded_nothing(tmp_path):
    closing = Closing(tmp_path)
    closing.recorder.report = NO_REPORT
    closing.ended()
    assert closing.at(closing.limit_s) is None
    assert closing.at(closing.limit_s + 0.1) == "the recorder does not record"


def test_what_is_not_closed_when_the_daemon_ends_is_not(tmp_path):
    closing = Closing(tmp_path).ended()
    closing.recorder.await_closed = lambda: None
    closing.control.close()
    assert closing.control.unrecorded() == "not closed before the daemon ended"


def test_a_disk_that_does_not_answer_is_no_recording(tmp_path):
    closing = Closing(tmp_path).ended()
    assert closing.at(closing.limit_s) is None
    assert "does the disk answer?" in closing.at(closing.limit_s + 0.1)


def test_nothing_is_asked_of_a_recording_that_is_not_required(tmp_path):
    assert Closing(tmp_path, required=False).ended().at(1.0) == ""
