"""A rig that waits for its host: time stands still for the rig, not for the time limits."""

import numpy as np
import pytest

from motord.config import Config, load
from motord.emulate.bench import CurrentCommand, EmulatedBench
from motord.rig.truth import load as load_truth
from motord.schema import TRUTH_DTYPE
from tests.unit.emulate.benches import beat, configure

MS = 1_000_000


def bench_with(patience_s: float | None, timeout_s: float = 0.1) -> EmulatedBench:
    config = load()
    changed = config.model_copy(
        update={
            "bench": config.bench.model_copy(update={"rig_patience_s": patience_s}),
            "inverter": config.inverter.model_copy(update={"timeout_s": timeout_s}),
            "bridge": config.bridge.model_copy(update={"heartbeat_timeout_s": 1.0}),
        }
    )
    assert isinstance(changed, Config)
    bench = EmulatedBench(changed, load_truth(None), 0)
    configure(bench.board, changed)
    return bench


def play(bench: EmulatedBench, until_ns: int, commanded: bool = True) -> None:
    number = 0
    while bench.now_ns < until_ns:
        if commanded:
            bench.arrive(bench.now_ns, beat(int(number > 0)))
            bench.arrive(bench.now_ns, CurrentCommand((8.0, -4.0, -4.0), True))
            number += 1
        bench.advance(min(bench.now_ns + MS, until_ns), lambda frame: None)


def truth_of(bench: EmulatedBench) -> np.record:
    row = np.zeros(1, TRUTH_DTYPE)
    bench.fill_truth(0, row[0])
    return row[0]


@pytest.mark.parametrize("patience_s", [None, 0.005])
def test_the_rig_waits_only_if_configured_to(patience_s: float | None) -> None:
    bench = bench_with(patience_s)
    play(bench, 20 * MS)
    assert truth_of(bench).inverter_on
    play(bench, 30 * MS, commanded=False)
    early = truth_of(bench)
    play(bench, 80 * MS, commanded=False)
    late = truth_of(bench)
    assert late.inverter_on  # the time limit is not over
    if patience_s is None:
        assert late.angle_rad != early.angle_rad
        assert bench.paused_ns == 0
    else:
        assert (late.angle_rad, late.i_a_A) == (early.angle_rad, early.i_a_A)
        assert bench.paused_ns == (80 - 19 - 5) * MS
    play(bench, 200 * MS, commanded=False)
    gone = truth_of(bench)  # the time limit passed: off, and the rig goes on
    assert not gone.inverter_on
    assert gone.i_a_A == pytest.approx(0.0, abs=0.01)
    assert bench.inverter.timeouts == 1


def test_it_goes_on_with_the_next_command() -> None:
    bench = bench_with(0.005)
    play(bench, 20 * MS)
    play(bench, 60 * MS, commanded=False)
    waited = truth_of(bench)
    paused_ns = bench.paused_ns
    play(bench, 70 * MS)
    assert truth_of(bench).angle_rad != waited.angle_rad
    assert bench.paused_ns == paused_ns > 0


def test_after_a_sleep_of_the_process_the_currents_are_those_of_the_last_command() -> None:
    bench = bench_with(0.005)
    play(bench, 20 * MS)
    angle_rad = truth_of(bench).angle_rad
    for ms in range(20, 60):  # what came while the process did not run
        bench.arrive(ms * MS, beat(1))
        bench.arrive(ms * MS, CurrentCommand((-4.0, 8.0, -4.0), True))
    bench.wake(60 * MS)
    bench.advance(54 * MS, lambda frame: None)
    assert truth_of(bench).angle_rad == angle_rad  # time stood still
    bench.advance(60 * MS, lambda frame: None)
    assert bench.paused_ns == 35 * MS
    asleep, awake = truth_of(bench), bench_with(None)
    awake.arrive(0, beat(0))
    for ms in range(60):
        awake.arrive(ms * MS, beat(1))
        awake.arrive(ms * MS, CurrentCommand((-4.0, 8.0, -4.0), True))
    awake.advance(60 * MS, lambda frame: None)
    assert asleep.i_a_A == pytest.approx(truth_of(awake).i_a_A, abs=0.01)
    assert asleep.i_b_A == pytest.approx(truth_of(awake).i_b_A, abs=0.01)
    assert abs(asleep.i_b_A) > 5.0
