"""The simulated rig as a HAL backend: catches up with the clock, times out, stops safely."""

from pathlib import Path

import numpy as np
import pytest

from motord import config
from motord.control.types import COMMAND, FEEDBACK
from motord.hal.sim.rig import SimRig
from motord.schema import BridgeStatus, InverterStatus

T0_NS = 1_800_000_000_000_000_000
READY_AND_LINE = InverterStatus.READY | InverterStatus.ENABLE_LINE


class Stand:
    """A rig read and commanded at times of the test's choice."""

    def __init__(self) -> None:
        self.rig = SimRig(config.load())
        self.rig.open()
        self.feedback, self.command = np.zeros(1, FEEDBACK), np.zeros(1, COMMAND)

    def read(self, at_ms: float) -> np.record:
        self.rig.read(T0_NS + round(at_ms * 1e6), self.feedback)
        return self.feedback.copy()[0]

    def write(self, i_a: float, enable: int) -> None:
        self.command[0].i_A[:] = i_a, -i_a / 2, -i_a / 2
        self.command[0].enable = enable
        self.rig.write(self.command)

    def hold(self, i_a: float, from_ms: int, to_ms: int) -> np.record:
        for at_ms in range(from_ms, to_ms):
            self.read(at_ms)
            self.write(i_a, 1)
        return self.read(to_ms)


@pytest.fixture
def stand() -> Stand:
    return Stand()


@pytest.mark.kernel
def test_samples_are_of_now_and_nothing_moves_before_the_first_read(stand: Stand) -> None:
    first = stand.read(0.0)
    assert first.now_ns == first.t_ns == first.t_inverter_ns == T0_NS
    assert first.u_bus_V == pytest.approx(24.0, abs=0.1)
    assert first.inverter_status == 0
    again = stand.read(5.0)
    assert again.t_ns == T0_NS + 5_000_000
    assert stand.rig._rig[1][0].step == 50


@pytest.mark.kernel
def test_clock_that_steps_back_stops_the_rig_but_not_the_samples(stand: Stand) -> None:
    stand.read(5.0)
    assert stand.read(1.0).t_ns == T0_NS + 1_000_000
    assert stand.rig._rig[1][0].step == 0
    stand.read(6.0)
    assert stand.rig._rig[1][0].step == 10


@pytest.mark.kernel
def test_commands_make_current_once_the_inverter_is_ready(stand: Stand) -> None:
    feedback = stand.hold(8.0, 0, 12)
    assert feedback.inverter_status == READY_AND_LINE
    assert feedback.bridge_status == BridgeStatus.ENABLE_LINE
    np.testing.assert_allclose(feedback.i_A, [8.0, -4.0, -4.0], atol=0.15)


@pytest.mark.kernel
def test_silence_switches_off_until_commanded_off(stand: Stand) -> None:
    stand.hold(8.0, 0, 12)  # the last command comes at 11 ms, the timeout is 50 ms
    assert stand.read(60.5).inverter_status == READY_AND_LINE
    late = stand.read(63.0)
    assert late.inverter_status == InverterStatus.COMMAND_TIMEOUT | InverterStatus.ENABLE_LINE
    assert abs(late.i_A[0] + 1.0 / 0.8) < 0.15  # nothing flows: the sensor's offset is left
    stand.write(8.0, 1)
    assert not stand.read(70.0).inverter_status & InverterStatus.READY
    stand.write(0.0, 0)
    assert stand.read(71.0).inverter_status == 0
    assert stand.hold(8.0, 71, 80).inverter_status == READY_AND_LINE


@pytest.mark.kernel
def test_safe_stop_opens_the_line_and_close_may_come_twice(stand: Stand) -> None:
    stand.hold(8.0, 0, 8)
    stand.rig.safe_stop()
    feedback = stand.read(9.0)
    assert feedback.inverter_status == feedback.bridge_status == 0
    stand.rig.close()
    stand.rig.close()
    assert stand.read(200.0).inverter_status == 0


def test_brake_and_drive_follow_the_command(stand: Stand) -> None:
    stand.command[0].drive_rad_s = 3.0
    for at_ms in range(0, 1500, 10):
        stand.read(at_ms)
        stand.write(0.0, 0)
    before, after = stand.read(1500).encoder_gray, stand.read(1600).encoder_gray
    assert before != after
    assert stand.rig._output[0].drive_rad_s == pytest.approx(3.0)


def test_rig_file_that_is_not_there_is_named() -> None:
    bench = config.load()
    elsewhere = bench.bench.model_copy(update={"rig": Path("/nowhere/x.toml")})
    wrong = bench.model_copy(update={"bench": elsewhere})
    with pytest.raises(
        config.ConfigError, match=r"\[bench\] rig: /nowhere/x\.toml: cannot read it"
    ):
        SimRig(wrong)
