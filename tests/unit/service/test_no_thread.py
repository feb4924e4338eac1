"""A system that allows no further thread: said at the start, and what has started needs none."""

import logging
import threading
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from motord.config import packaged
from motord.process.ending_threads import NO_THREAD, NoThreadError
from motord.recorder import main as recorder
from motord.recorder.protocol import BlackBoxRequest
from motord.recorder.session import Session
from motord.service import daemon
from motord.service.host.log import log_to_stderr
from motord.service.publish.telemetry import Telemetry
from tests.unit.service.virtual_service import packaged_bench


def refuse(_thread):
    raise RuntimeError("can't start new thread")


@pytest.fixture
def no_thread(monkeypatch):
    """What has the system allow no further thread from its call on."""
    return lambda: monkeypatch.setattr(threading.Thread, "start", refuse)


def test_a_plan_is_started_and_noted_and_the_queue_is_kept(played, no_thread):
    no_thread()
    played.begin_plan()
    assert played.supervisor.bench.plans.active
    played.supervisor.bench.plans._journal.journal.settle()
    assert "calibrate" in (played.folder / "plans" / "played.jsonl").read_text()
    played.supervisor.queue.file.save(played.supervisor.queue.queue)
    played.supervisor.queue.file.settle()
    assert (played.folder / "plans" / "played.queue.json").exists()


def test_a_black_box_is_written(tmp_path, run_dir, ring, no_thread):
    session = Session(run_dir.ring, packaged_bench().recording)
    ring.publish()
    no_thread()
    account = {"cause": "OVERSPEED", "reason": "too fast", "t_ns": 1}
    box = BlackBoxRequest(tmp_path / "box-20260101T000000.mcap", None, 10, 0, {}, account)
    session.boxes.request(box, 0.0)
    session.boxes.finish()
    assert session.boxes.outcomes == {str(box.path): ""}


def test_a_recorder_says_why_it_does_not_start(run_dir, no_thread, capsys):
    no_thread()
    arguments = ["--config", str(packaged("sim.toml")), "--dir", str(run_dir.path)]
    assert recorder.main(arguments) == 1
    assert NO_THREAD in capsys.readouterr().err


class HalfStarted(Telemetry):
    """Starts its thread, and then there is none for what comes next."""

    def start(self):
        super().start()
        raise NoThreadError(NO_THREAD)


def test_a_daemon_whose_start_fails_half_way_leaves_no_thread(monkeypatch):
    for name in ("gc", "scheduling"):  # this process is none of a daemon
        monkeypatch.setattr(daemon, name, MagicMock())
    telemetry, before = (
        HalfStarted(lambda name, payload: None, 1000, 50, 0.05),
        set(threading.enumerate()),
    )
    config = packaged_bench()
    bench = SimpleNamespace(config=config, devices={})
    half = daemon.Daemon(MagicMock(bench=bench), MagicMock(), telemetry, MagicMock())
    with pytest.raises(NoThreadError), daemon.started(half):
        pass
    assert set(threading.enumerate()) <= before
    half.api.close.assert_called_once()


def test_a_log_that_cannot_be_written_is_not_begun(no_thread):
    no_thread()
    before = list(logging.getLogger("motord").handlers)
    with pytest.raises(NoThreadError, match="ulimit -u"), log_to_stderr():
        pass
    assert logging.getLogger("motord").handlers == before
