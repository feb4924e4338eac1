"""The life of the loop process, run inside the test: order of events, refusals, failures."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from motord.config import Config, keep
from motord.hal import registry
from motord.hal.base import DeviceError
from motord.loop import control_loop, process, rt_setup
from motord.loop import main as entry
from motord.loop.rt_setup import RealtimeStatus
from motord.loop.status import LoopPhase, LoopStatus
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from motord.shm.shared_records import SharedFileError
from motord.shm.tables import TablesWriter
from tests.support.loop_process import start_loop
from tests.support.patience import PATIENCE_S
from tests.unit.loop.bench import BENCH, ScriptedRig, Supervisor, write_bench

WARM_UP_READS = 3


class LoopBench:
    """Files of a bench and a scripted rig that ends the loop in its 20th read after warming up."""

    def __init__(self, folder: Path) -> None:
        self.config_path = write_bench(folder)
        self.run_dir = RunDir("fake", folder)
        self.supervisor = Supervisor(self.run_dir, self.config_path)
        self.rig = ScriptedRig(self.terminate_at_20)

    def terminate_at_20(self, reads: int) -> None:
        if reads == WARM_UP_READS + 19:
            signal.raise_signal(signal.SIGTERM)

    def run(self) -> int:
        arguments = ["--config", str(self.config_path), "--dir", str(self.run_dir.path)]
        return entry.main(arguments)

    @property
    def status(self) -> LoopStatus:
        status = LoopStatus.read(self.run_dir.loop_status)
        assert status is not None
        return status


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LoopBench]:
    bench = LoopBench(tmp_path)
    # the heartbeat is of before the loop, in this process, which may be kept waiting
    monkeypatch.setattr(control_loop, "SUPERVISOR_GONE_S", PATIENCE_S)
    monkeypatch.setattr(registry, "make_rig", lambda _config: bench.rig)
    monkeypatch.setattr(rt_setup, "apply", lambda _loop: NO_RIGHTS)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    before = {s: signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    yield bench
    for number, handler in before.items():
        signal.signal(number, handler)


NO_RIGHTS = RealtimeStatus(
    items=[],
    kernel="Linux",
    preemption="none",
    rt_runtime_us=None,
    rt_period_us=None,
    isolated_cpus="",
)


def test_terminated_loop_stops_safely_and_accounts(bench: LoopBench) -> None:
    phases: list[LoopPhase] = []
    bench.rig.on_read = lambda reads: (
        phases.append(bench.status.phase),
        bench.terminate_at_20(reads),
    )[1]
    assert bench.run() == 0
    assert phases == [LoopPhase.STARTING] * WARM_UP_READS + [LoopPhase.READY] * 20
    assert bench.rig.calls == ["open", "safe_stop", "close"]
    assert bench.rig.commands
    assert all(command["enable"] == 0 for command in bench.rig.commands)
    status = bench.status
    assert (status.phase, status.reason, status.error) == (LoopPhase.STOPPED, "SIGTERM", "")
    assert (status.pid, status.ticks, status.rate_Hz) == (os.getpid(), 20, 1000)
    assert status.wake_late.samples == status.work.samples == 20
    assert status.realtime == NO_RIGHTS
    assert status.offset_ns == bench.supervisor.clock.offset_ns
    reader = RingReader(bench.run_dir.ring, "oldest")
    assert reader.closed
    block, lost = reader.read()
    assert (len(block), lost) == (20, 0)
    assert int(block["missed"][-1]) == status.missed == int(block["tick"][-1]) - 19


def test_device_error_in_the_loop(bench: LoopBench, capsys: pytest.CaptureFixture[str]) -> None:
    def fail(reads: int) -> None:
        if reads == WARM_UP_READS + 5:
            raise DeviceError("can0: gone; plug it in")

    bench.rig.on_read = fail
    assert bench.run() == 1
    assert bench.rig.calls == ["open", "safe_stop", "close"]
    assert (bench.status.phase, bench.status.error) == (LoopPhase.FAILED, "can0: gone; plug it in")
    assert bench.status.ticks == 5
    assert capsys.readouterr().err == "loop: can0: gone; plug it in\n"


def test_unexpected_error_is_named_and_traced(
    bench: LoopBench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.rig.on_read = lambda reads: {}[reads]
    assert bench.run() == 1
    assert bench.status.error == "KeyError: 0"
    error = capsys.readouterr().err
    assert error.startswith("Traceback")
    assert error.endswith("loop: KeyError: 0\n")
    assert bench.rig.calls[-2:] == ["safe_stop", "close"]


def test_device_that_does_not_open(bench: LoopBench, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise DeviceError("no answer from the board")

    monkeypatch.setattr(bench.rig, "open", refuse)
    assert bench.run() == 1
    assert bench.rig.calls == ["safe_stop", "close"]
    assert bench.status.error == "no answer from the board"


def test_devices_are_closed_even_if_they_do_not_stop(
    bench: LoopBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse() -> None:
        raise DeviceError("bus off")

    monkeypatch.setattr(bench.rig, "safe_stop", refuse)
    assert bench.run() == 1
    assert bench.rig.calls == ["open", "close"]
    assert bench.status.error == "bus off"


def test_wrong_config_names_the_file(bench: LoopBench) -> None:
    bench.config_path.write_text("[motor]\n")
    assert bench.run() == 1
    assert "fake.toml" in bench.status.error
    assert bench.rig.calls == []


@pytest.mark.parametrize("missing", ["tables", "setpoint"])
def test_missing_files(bench: LoopBench, missing: str) -> None:
    (bench.run_dir.path / missing).unlink()
    assert bench.run() == 1
    assert f"{missing}: cannot open" in bench.status.error


def test_tables_must_be_written_and_fit(bench: LoopBench) -> None:
    TablesWriter(bench.run_dir.tables, 4096)
    assert bench.run() == 1
    assert "no tables for an encoder of 4096 counts" in bench.status.error
    with pytest.raises(SharedFileError):
        TablesWriter(bench.run_dir.path / "absent" / "tables", 4096)


def test_a_bench_file_edited_while_the_daemon_runs_changes_nothing_until_it_starts_anew(
    bench: LoopBench,
) -> None:
    """Else a loop that is started again had drivers of the new file and tables of the old one."""
    bench.run_dir.bench_file.write_text(BENCH)
    bench.config_path.write_text(BENCH.replace("rate_Hz = 1000", "rate_Hz = 5000"))
    assert bench.run() == 0
    assert bench.status.rate_Hz == 1000


def test_files_that_a_bench_file_names_are_those_that_the_daemon_read(
    bench: LoopBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An edited rig or DBC changes no loop that is started again under the limits of the old."""
    rig = tmp_path / "rig.toml"
    rig.write_text("before")
    text = BENCH.replace("[bench]", '[bench]\nrig = "rig.toml"')
    bench.config_path.write_text(text)
    seen = []

    def make_rig(config: Config) -> ScriptedRig:
        seen.append(config.bench.rig.read_text() if config.bench.rig else "")
        return bench.rig

    monkeypatch.setattr(registry, "make_rig", make_rig)
    keep(bench.config_path, text, bench.run_dir.bench_file)
    rig.write_text("after")
    assert bench.run() == 0
    assert seen == ["before"]


def test_second_loop_waits_then_gives_up(bench: LoopBench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "PREDECESSOR_WAIT_S", 0.0)
    with bench.run_dir.lock("loop", 0.0):
        assert bench.run() == 1
    assert f"loop process {os.getpid()} holds" in bench.status.error
    assert bench.rig.calls == []


def test_status_that_cannot_be_written_is_said(
    tmp_path: Path, bench: LoopBench, capsys: pytest.CaptureFixture[str]
) -> None:
    absent = RunDir("absent", tmp_path)
    assert process.LoopProcess(bench.config_path, absent).run() == 1
    assert "loop.json: there is no folder" in capsys.readouterr().err


def test_interrupt_and_hangup_are_left_to_the_supervisor(bench: LoopBench) -> None:
    bench.run()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def test_foreign_threads_are_named() -> None:
    leave = threading.Event()
    thread = threading.Thread(target=leave.wait, name="meddler")
    thread.start()
    try:
        assert "meddler (Python)" in process.foreign_threads()
    finally:
        leave.set()
        thread.join()
    assert "meddler (Python)" not in process.foreign_threads()


def test_status_file(tmp_path: Path) -> None:
    path = tmp_path / "loop.json"
    assert LoopStatus.read(path) is None
    for nonsense in (
        '{"phase": "rea',
        "[" * 10_000,
        '{"phase": "ready", "pid": []}',
        "x" * (2 << 20),
    ):
        path.write_text(nonsense)
        with pytest.raises(OSError, match="status of a loop"):
            LoopStatus.read(path)
    status = LoopStatus(phase=LoopPhase.READY, pid=7, foreign_threads=["x"])
    status.write(path)
    assert LoopStatus.read(path) == status
    assert [p.name for p in tmp_path.iterdir()] == ["loop.json"]


def test_launched_loop_is_a_process_of_its_own(bench: LoopBench) -> None:
    LoopStatus(phase=LoopPhase.STOPPED, pid=1).write(bench.run_dir.loop_status)
    bench.config_path.write_text("")
    with start_loop(bench.config_path, bench.run_dir) as started:
        assert started.wait() == 1
    assert bench.status.pid == started.pid
    assert started.args == bench.run_dir.command("motord.loop.main", bench.config_path)


def test_the_loop_loads_nothing_heavy_besides_its_compiler_and_no_experiments() -> None:
    pytest.importorskip("asammdf")  # which `import can` would load, with pandas
    script = (
        "import sys, motord.loop.process, motord.wire.can.dbc, motord.hal.can.bus\n"
        "import motord.hal.can.python_can, motord.hal.sim.rig, motord.config as config\n"
        "bench = config.packaged('sim.toml')\n"
        "config.load_started(bench, bench, plans=False)\n"
        "heavy = {'asammdf', 'pandas', 'pyarrow', 'zenoh', 'yaml', 'scipy', 'motord.experiments'}\n"
        "print(heavy & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr
