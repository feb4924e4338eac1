"""Which rate holds on the wire, and who does not keep up with one that does not."""

import math

from motord.shm.time_count import count_time
from motord.shm.timing import Timing
from tests.benchmarks.bench_wire import Step, highest
from tests.benchmarks.figure import Figure


def a_slice(work_us: float, missed: int = 0) -> Timing:
    timing = Timing()
    for _ in range(100):
        count_time(timing.wake_late.cells, 50)
        count_time(timing.work.cells, round(work_us * 1e3))
    timing.record["missed"] = missed
    return timing


def step(rate_Hz: int, *slices: Timing, skipped: int = 0, emulated: bool = False) -> Step:
    made = Step(rate_Hz, emulated, peer={"ticks": 1000, "skipped": skipped, "cpu_s": 0.02})
    made.slices.clean = list(slices)
    return made


def test_a_rate_holds_if_work_ends_within_the_period_and_hardly_any_is_missed() -> None:
    assert step(1000, a_slice(900.0)).limits == ""
    assert step(1000, a_slice(1100.0)).limits == "the loop"
    assert step(1000, a_slice(900.0, missed=3)).limits == "the loop"
    stall_in_one = [a_slice(900.0, missed=50), a_slice(900.0), a_slice(900.0)]
    assert step(1000, *stall_in_one).limits == ""


def test_only_the_emulator_has_to_keep_up_with_the_loop() -> None:
    assert step(1000, a_slice(90.0), skipped=100).limits == ""
    assert step(1000, a_slice(90.0), skipped=100, emulated=True).limits == "the emulator"
    assert step(1000, a_slice(90.0), skipped=10, emulated=True).limits == ""


def test_the_highest_rate_that_holds() -> None:
    steps = [step(1000, a_slice(90.0)), step(2000, a_slice(90.0)), step(20_000, a_slice(90.0))]
    top, *each = highest("a wire", steps)
    assert (top.value, top.met, len(each)) == (2000, True, 3)
    assert "at 20000 Hz the loop does not keep up" in top.note
    assert "peer 20 us a tick" in each[0].note


def test_a_rate_without_clean_slices_gives_nothing() -> None:
    top: Figure = highest("a wire", [step(1000)])[0]
    assert math.isnan(top.value)
    assert top.met is None
