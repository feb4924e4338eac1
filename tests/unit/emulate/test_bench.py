import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.config import load
from motord.emulate.bench import ADVANCE_MAX_NS, CurrentCommand, EmulatedBench
from motord.rig.truth import RigTruth
from motord.schema import TRUTH_DTYPE, InverterStatus
from motord.wire.bridge import frames
from motord.wire.modbus.registers import DeviceStatus
from tests.unit.emulate.benches import EMULATED, beat, configure

MS = 1_000_000
CONFIG = load(EMULATED)
TRUTH = RigTruth()
TIMEOUT_MS = round(CONFIG.inverter.timeout_s * 1000)
HEARTBEAT_TIMEOUT_MS = round(CONFIG.bridge.heartbeat_timeout_s * 1000)
CURRENTS = (5.0, -2.5, -2.5)


def ignore(_frame):
    pass


def truth_of(bench: EmulatedBench) -> np.ndarray:
    row = np.zeros(1, TRUTH_DTYPE)
    bench.fill_truth(bench.now_ns, row[0])
    return row


def operate(bench: EmulatedBench, from_ms: int, to_ms: int, *, commands=True, beats=True) -> None:
    """Be a host with a tick of 1 ms."""
    if from_ms == 0 and beats:
        bench.arrive(0, beat(0))
    for ms in range(from_ms, to_ms):
        if commands:
            bench.arrive(ms * MS, CurrentCommand(CURRENTS, True))
        if beats:
            bench.arrive(ms * MS, beat(1))
        bench.advance((ms + 1) * MS, ignore)


def sensed_A(bench: EmulatedBench) -> float:
    return float(np.abs(bench.sense().i_sensed_A).max())


@pytest.fixture
def bench() -> EmulatedBench:
    bench = EmulatedBench(CONFIG, TRUTH, 0)
    configure(bench.board, CONFIG)
    return bench


def test_commands_give_currents(bench):
    operate(bench, 0, 30)
    reading = bench.sense()
    assert reading.i_sensed_A == pytest.approx(CURRENTS, abs=0.3)
    assert bench.inverter_status(reading) == InverterStatus.READY | InverterStatus.ENABLE_LINE
    assert truth_of(bench)["inverter_on"][0] == 1


def test_without_the_enable_line_no_current_flows(bench):
    operate(bench, 0, 30, beats=False)
    assert sensed_A(bench) < 0.3
    assert bench.inverter_status(bench.sense()) == InverterStatus(0)


def test_silence_on_the_bus_zeroes_the_currents_at_the_timeout(bench):
    operate(bench, 0, 30)
    silent_from = 29  # the last command
    operate(bench, 30, silent_from + TIMEOUT_MS, commands=False)
    assert sensed_A(bench) > 4.0
    operate(bench, silent_from + TIMEOUT_MS, silent_from + TIMEOUT_MS + 5, commands=False)
    assert sensed_A(bench) < 0.3
    assert bench.inverter.timeouts == 1
    assert bench.inverter_status(bench.sense()) & InverterStatus.COMMAND_TIMEOUT


def test_silence_of_heartbeats_opens_the_line_at_the_timeout(bench):
    operate(bench, 0, 30)
    operate(bench, 30, 29 + HEARTBEAT_TIMEOUT_MS, beats=False)
    assert truth_of(bench)["enable_line"][0] == 1
    operate(bench, 29 + HEARTBEAT_TIMEOUT_MS, 30 + HEARTBEAT_TIMEOUT_MS, beats=False)
    assert truth_of(bench)["enable_line"][0] == 0
    assert truth_of(bench)["inverter_on"][0] == 0
    assert bench.board.heartbeat_drops == 1


@settings(max_examples=15)
@given(
    st.lists(st.integers(0, 100_000), max_size=15),
    st.lists(st.integers(1, 99), max_size=10),
)
def test_how_time_is_cut_makes_no_difference(arrivals_us, cuts_ms):
    """The rig does the same however late and how often the process gets to advance it."""
    benches = [EmulatedBench(CONFIG, TRUTH, 0) for _ in range(2)]
    for bench in benches:
        bench.arrive(0, beat(0))
        for number, at_us in enumerate(sorted(arrivals_us)):
            bench.arrive(at_us * 1000, CurrentCommand((float(number), 0.0, 0.0), True))
            bench.arrive(at_us * 1000, beat(1))
    benches[0].advance(100 * MS, ignore)
    for cut_ms in [*sorted(cuts_ms), 100]:
        benches[1].advance(cut_ms * MS, ignore)
    one, other = (truth_of(bench)[0].item() for bench in benches)
    assert one == pytest.approx(other, rel=1e-9, abs=1e-9)


def test_a_stall_of_the_host_is_bounded(bench):
    bench.advance(ADVANCE_MAX_NS * 20, ignore)
    assert bench.now_ns == ADVANCE_MAX_NS * 20
    assert bench.skipped_ns == ADVANCE_MAX_NS * 19
    assert (bench.played_ns, bench.paused_ns) == (ADVANCE_MAX_NS, 0)


def test_what_came_in_time_holds_off_timeouts_however_long_the_stall_lasted(bench):
    """A host that was silent for a while goes on, and the devices take note of it only later."""
    operate(bench, 0, 30)
    silent_ms, stall_ms = TIMEOUT_MS * 6 // 10, TIMEOUT_MS * 9 // 10
    bench.advance((29 + silent_ms) * MS, ignore)
    assert bench.inverter_status(bench.sense()) & InverterStatus.READY
    end_ms = 29 + silent_ms + stall_ms
    for ms in range(30 + silent_ms, end_ms):
        bench.arrive(ms * MS, CurrentCommand(CURRENTS, True))
        bench.arrive(ms * MS, beat(1))
    bench.advance(end_ms * MS, ignore)
    assert bench.skipped_ns > 0
    assert (bench.inverter.timeouts, bench.board.heartbeat_drops) == (0, 0)
    assert bench.inverter_status(bench.sense()) == InverterStatus.READY | InverterStatus.ENABLE_LINE


def test_a_timeout_within_a_stall_is_as_long_ago_as_the_silence(bench):
    operate(bench, 0, 30)
    bench.arrive(31 * MS, CurrentCommand(CURRENTS, True))
    bench.advance(29 * MS + 3 * TIMEOUT_MS * MS, ignore)
    assert bench.inverter.timeouts == bench.board.heartbeat_drops == 1
    assert bench.inverter.commanded_ns == 31 * MS


def test_an_arrival_from_before_a_stall_takes_effect_now(bench):
    bench.advance(10 * MS, ignore)
    bench.arrive(3 * MS, CurrentCommand(CURRENTS, True))
    bench.advance(11 * MS, ignore)
    assert bench.inverter.deadline_ns == (10 + TIMEOUT_MS) * MS


def test_the_board_answers_at_its_time(bench):
    answers = []
    bench.arrive(5 * MS, frames.Numbered(0, frames.HelloRequest(frames.PROTOCOL)))
    bench.advance(4 * MS, answers.append)
    assert answers == []
    bench.advance(6 * MS, answers.append)
    assert answers == [bench.board.hello()]


def test_brake_and_drive_act_on_the_rig_and_read_it(bench):
    for ms in (100, 200, 300, 400):  # oftener than the drive's watchdog asks for
        bench.drive.write(0, [5000])
        bench.brake.write(0, [10_000])
        bench.advance(ms * MS, ignore)
    reading = bench.sense()
    assert bench.drive.value == pytest.approx(reading.drive_rad_s) == pytest.approx(2.0, abs=0.1)
    assert bench.brake.value == pytest.approx(reading.brake_temperature_C)
    assert bench.brake.status == DeviceStatus.READY


def test_a_brake_that_is_too_hot_says_so():
    cold = CONFIG.model_copy(
        update={"brake": CONFIG.brake.model_copy(update={"temperature_max_C": 20.0})}
    )
    bench = EmulatedBench(cold, TRUTH, 0)
    bench.sense()
    assert bench.brake.status == DeviceStatus.FAULT


def test_a_fault_is_reported(bench):
    assert InverterStatus.FAULT in bench.inverter_status(bench.sense()._replace(fault=1))
