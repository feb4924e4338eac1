"""Measuring latencies: slices sorted by the steal counter, cyclictest read, figures made."""

import io
import os
import stat
import sys
from pathlib import Path

import numpy as np
import pytest

from motord.config import LoopConfig
from motord.loop import rt_setup
from motord.loop.latency import LatencyError, cyclictest, measured_loop, measurement
from motord.loop.latency.measured_loop import LoopSetup, Ready
from motord.loop.latency.measurement import (
    LoopOnDemand,
    Measured,
    MeasuredSlices,
    MeasurementPlan,
    measure,
    stolen_ticks,
    timing_of,
)
from motord.loop.latency.picture import picture
from motord.loop.latency.report import report
from motord.loop.rt_setup import RealtimeStatus
from motord.shm.time_count import count_time
from motord.shm.timing import TIMING, Timing
from tests.support.patience import PATIENCE_S

PERIOD_NS = 1_000_000
RIGHTS = RealtimeStatus(
    items=[],
    kernel="Linux",
    preemption="none",
    rt_runtime_us=950_000,
    rt_period_us=1_000_000,
    isolated_cpus="",
)
READY = Ready(realtime=RIGHTS, priority=80)
STAT = """cpu  10 0 10 100 0 0 0 7 0 0
cpu0 5 0 5 50 0 0 0 3 0 0
cpu1 5 0 5 50 0 0 0 4 0 0
cpu10 5 0 5 50
intr 5
"""


def timing(late_ns: int, samples: int = 100, missed: int = 0, work_ns: int = 9_000) -> Timing:
    made = Timing()
    for _ in range(samples):
        count_time(made.wake_late.cells, late_ns)
        count_time(made.work.cells, work_ns)
    made.record["missed"] = missed
    return made


def test_steal_counter(tmp_path: Path) -> None:
    (tmp_path / "stat").write_text(STAT)
    counted = [stolen_ticks(cpu, tmp_path / "stat") for cpu in (0, 1, 10, 2)]
    assert counted == [3, 4, 0, 0]
    assert stolen_ticks(0) >= 0


def test_periods_are_whole_microseconds() -> None:
    plan = MeasurementPlan(LoopConfig(rate_Hz=3000), 1.0, slice_s=0.4)
    assert (plan.period_us, plan.ticks, plan.settle_ticks) == (333, 1201, 60)


def test_latencies_of_whole_periods_are_missed_deadlines() -> None:
    made = timing_of([5_000, 999_999, PERIOD_NS, 3 * PERIOD_NS + 1], PERIOD_NS)
    assert (made.missed, made.wake_late.summary().samples) == (4, 4)


def stub(folder: Path, script: str) -> str:
    path = folder / "cyclictest"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def run_stub(folder: Path, script: str) -> list[int]:
    return cyclictest.run(stub(folder, script), period_us=1000, loops=3, cpu=0, priority=80)


def test_cyclictest_is_read_line_by_line(tmp_path: Path) -> None:
    text = "echo 'Thread 0 Interval: 1500'; echo '  0:   0:   10629'; echo '  0:   1:    4000'"
    assert run_stub(tmp_path, text) == [10629, 4000]


def test_cyclictest_gets_the_loops_conditions() -> None:
    arguments = cyclictest.command("/c", period_us=250, loops=9, cpu=1, priority=70)
    assert {"--interval=250", "--loops=9", "--affinity=1", "--priority=70"} < set(arguments)
    normal = cyclictest.command("/c", period_us=250, loops=9, cpu=1, priority=0)
    assert "--policy=other" in normal


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("echo 'no right to do it' >&2; exit 3", "code 3: no right to do it"),
        ("exit 0", "code 0: it printed no latencies"),
    ],
)
def test_cyclictest_that_fails_is_one_line(tmp_path: Path, script: str, expected: str) -> None:
    with pytest.raises(LatencyError, match=expected):
        run_stub(tmp_path, script)


def test_cyclictest_that_cannot_be_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LatencyError, match="No such file"):
        cyclictest.run(str(tmp_path / "none"), period_us=1000, loops=3, cpu=0, priority=80)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(LatencyError, match="apt-get install rt-tests"):
        cyclictest.find()


class FakeLoop:
    """Instead of the loop's process: every slice takes 50 ns late and 9 us."""

    def __init__(self, setup: LoopSetup) -> None:
        self.setup = setup
        self.ready = READY

    def __enter__(self) -> "FakeLoop":
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing to end."""

    def run(self, _settle_ticks: int, ticks: int) -> Timing:
        return timing(50, ticks)


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Measuring without loop, cyclictest and time; the list says where the counter moves."""
    moves: list[int] = []
    looks = iter(range(10**6))
    monkeypatch.setattr(measurement, "LoopOnDemand", FakeLoop)
    monkeypatch.setattr(measurement, "SETTLE_S", 0.002)
    monkeypatch.setattr(measurement, "_ACCOUNT_S", 0.0)
    monkeypatch.setattr(cyclictest, "find", lambda: "/cyclictest")
    monkeypatch.setattr(cyclictest, "run", lambda _path, **_k: [9_000_000] * 2 + [8_000] * 20)

    def look(_cpu: int) -> int:
        n = next(looks)
        return sum(n > move for move in moves)

    monkeypatch.setattr(measurement, "stolen_ticks", look)
    return moves


def plan(**other: object) -> MeasurementPlan:
    return MeasurementPlan(LoopConfig(rate_Hz=1000), 1e9, **{"slice_s": 0.02, "enough": 5, **other})


def test_goes_on_until_there_are_enough_clean_slices(machine: list[int]) -> None:
    machine += [0, 6]  # within the first slice of the loop and the second of cyclictest
    rounds: list[int] = []
    measured = measure(plan(compare=True), lambda m: rounds.append(m.clean))
    assert rounds == [0, 1, 2, 3, 4, 5]
    assert measured.cyclictest is not None
    assert [len(kind.clean) for kind in measured.kinds] == [5, 5]
    assert [len(kind.stolen) for kind in measured.kinds] == [1, 1]
    assert measured.loop.of(clean=True).wake_late.summary().samples == 100
    assert measured.cyclictest.of(clean=True).wake_late.max_ns == 8_000  # the settling is dropped


def test_ends_when_the_time_is_over(machine: list[int]) -> None:
    measured = measure(MeasurementPlan(LoopConfig(), 0.0, slice_s=0.01))
    assert (len(measured.loop.clean), measured.cyclictest) == (1, None)


def test_a_processor_that_is_not_allowed(machine: list[int]) -> None:
    allowed = sorted(os.sched_getaffinity(0))
    with pytest.raises(LatencyError, match="cpu = 4000 cannot be used"):
        measure(MeasurementPlan(LoopConfig(cpu=4000), 0.0))
    assert measure(MeasurementPlan(LoopConfig(cpu=allowed[0]), 0.0, slice_s=0.01)).cpu == allowed[0]
    assert measure(MeasurementPlan(LoopConfig(), 0.0, slice_s=0.01)).cpu == allowed[-1]


def compared() -> Measured:
    loop = MeasuredSlices([timing(50), timing(60, missed=1)], [timing(40_000, missed=9)])
    reference = MeasuredSlices([timing(10_000), timing(12_000)], [])
    return Measured(plan(compare=True), 1, READY, loop, reference, 2.0)


def test_report_is_over_clean_slices_and_the_rest_apart() -> None:
    found = report(compared())
    assert found.loop.p50_us == pytest.approx(0.05, rel=0.05)
    assert (found.loop.missed, found.loop.samples) == (1, 200)
    assert found.cyclictest is not None
    assert found.ratio is not None
    assert found.ratio.p50 == pytest.approx(0.005, rel=0.05)
    assert found.ratio.p99 == pytest.approx(0.005, rel=0.05)
    assert found.ratio_of_medians is not None
    assert found.ratio_of_medians.p50 == pytest.approx(0.005, rel=0.05)
    assert found.work.p50_us == pytest.approx(9.0, rel=0.04)
    assert found.slices == {"clean": 4, "stolen": 1}
    assert (found.stolen.loop.missed, found.stolen.loop.samples) == (9, 100)
    assert found.stolen.cyclictest is not None
    assert found.stolen.cyclictest.p50_us is None
    assert (found.rate_Hz, found.cpu, found.priority, found.spin) == (1000, 1, 80, True)


def test_report_without_a_clean_slice_or_without_reference() -> None:
    measured = compared()
    measured.loop.clean.clear()
    found = report(measured)
    assert found.ratio is not None
    assert (found.ratio.p50, found.ratio.p99, found.loop.p50_us) == (None, None, None)
    assert found.ratio_of_medians is not None
    assert found.ratio_of_medians.p50 is None
    measured.cyclictest = None
    alone = report(measured)
    assert (alone.cyclictest, alone.ratio, alone.ratio_of_medians) == (None, None, None)


def test_picture_has_both_histograms() -> None:
    above, below = picture(compared()).axes
    labels = [text.get_text() for text in above.get_legend().get_texts()]
    assert labels == ["cyclictest, clean slices", "loop, clean slices", "loop, stolen from"]
    assert len(below.get_legend().get_texts()) == 2
    nothing = Measured(plan(), 1, READY)
    assert picture(nothing).axes[0].get_legend() is None


def test_the_loop_runs_slices_on_demand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    monkeypatch.setattr(rt_setup, "apply", lambda _loop: RIGHTS)
    setup = LoopSetup(loop=LoopConfig(rate_Hz=1000), period_ns=PERIOD_NS)
    lines = f"{setup.model_dump_json()}\n2 10\n1 20\n".encode()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(lines)))
    assert measured_loop.main() == 0
    sys.stdout.flush()
    line, _, rest = capfdbinary.readouterr().out.partition(b"\n")
    assert Ready.model_validate_json(line).realtime == RIGHTS
    slices = [Timing(part.reshape(1)) for part in np.frombuffer(rest, TIMING)]
    assert [part.wake_late.summary().samples for part in slices] == [10, 20]
    assert [part.work.summary().samples for part in slices] == [10, 20]
    assert all(part.work.max_ns > 0 for part in slices)


def test_a_loop_that_dies_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(LatencyError, match="the loop ended with code 1"):
        LoopOnDemand(LoopSetup(loop=LoopConfig(), period_ns=PERIOD_NS))


@pytest.mark.parametrize(
    ("end_s", "serve"), [(PATIENCE_S, "sys.stdin.read()"), (0.1, "signal.pause()")]
)
def test_an_interrupt_while_the_loop_starts_ends_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, end_s: float, serve: str
) -> None:
    """It removes its ring where it takes note of the end of its input."""
    monkeypatch.setattr(measurement, "END_S", end_s)
    started, ended = tmp_path / "pid", tmp_path / "ended"
    code = (
        f"import os, signal, sys; open({str(started)!r}, 'w').write(str(os.getpid()));"
        f"os.kill(os.getppid(), signal.SIGINT); {serve}; open({str(ended)!r}, 'w')"
    )
    monkeypatch.setattr(measurement, "module_command", lambda _: [sys.executable, "-c", code])
    with pytest.raises(KeyboardInterrupt):
        LoopOnDemand(LoopSetup(loop=LoopConfig(), period_ns=PERIOD_NS))
    with pytest.raises(ProcessLookupError):
        os.kill(int(started.read_text()), 0)
    assert ended.exists() == (serve == "sys.stdin.read()")


def test_a_loop_that_is_interrupted_at_its_start_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    ready = Ready(realtime=RIGHTS, priority=7).model_dump_json()
    code = f"import os, signal; os.kill(os.getpid(), signal.SIGINT); print({ready!r})"
    monkeypatch.setattr(measurement, "module_command", lambda _: [sys.executable, "-c", code])
    with LoopOnDemand(LoopSetup(loop=LoopConfig(), period_ns=PERIOD_NS)) as loop:
        assert loop.ready.priority == 7
