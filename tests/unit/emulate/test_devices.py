import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.config import ModbusConfig
from motord.emulate.devices import NEVER_NS, ZERO_A, Inverter, RegisterDevice
from motord.wire.modbus.registers import DeviceStatus

MS = 1_000_000
CURRENTS = (1.0, -0.5, -0.5)


def test_an_inverter_follows_commands_while_they_come():
    inverter = Inverter(0.05)
    for ms in range(0, 500, 49):
        inverter.expire(ms * MS)
        inverter.command(ms * MS, CURRENTS, True)
        assert (inverter.i_A, inverter.enabled) == (CURRENTS, True)
    assert inverter.timeouts == 0


def test_silence_zeroes_the_currents_at_the_timeout_and_not_before():
    inverter = Inverter(0.05)
    inverter.command(7 * MS, CURRENTS, True)
    inverter.expire(57 * MS - 1)
    assert inverter.i_A == CURRENTS
    inverter.expire(57 * MS)
    assert (inverter.i_A, inverter.enabled, inverter.timed_out) == (ZERO_A, False, True)
    assert (inverter.timeouts, inverter.deadline_ns) == (1, NEVER_NS)


def test_after_a_timeout_it_stays_off_until_commanded_off():
    inverter = Inverter(0.05)
    inverter.command(0, CURRENTS, True)
    inverter.expire(60 * MS)
    inverter.command(61 * MS, CURRENTS, True)
    assert (inverter.i_A, inverter.enabled, inverter.timed_out) == (ZERO_A, False, True)
    inverter.command(62 * MS, ZERO_A, False)
    assert not inverter.timed_out
    inverter.command(63 * MS, CURRENTS, True)
    assert (inverter.i_A, inverter.enabled) == (CURRENTS, True)


def test_disabled_means_no_current():
    inverter = Inverter(0.05)
    inverter.command(0, CURRENTS, False)
    assert (inverter.i_A, inverter.enabled) == (ZERO_A, False)


@pytest.mark.parametrize("wild", [math.nan, math.inf, -math.inf])
def test_currents_that_are_not_finite_are_zero(wild):
    inverter = Inverter(0.05)
    inverter.command(0, (1.0, wild, 1.0), True)
    assert inverter.i_A == ZERO_A


@given(
    st.lists(
        st.tuples(st.integers(0, 80), st.booleans(), st.one_of(st.none(), st.just(CURRENTS))),
        max_size=30,
    )
)
def test_current_only_flows_within_the_timeout_of_an_enabling_command(steps):
    """Whatever the order of commands and silences."""
    inverter = Inverter(0.05)
    now_ms, last_enable_ms = 0, -1000
    for wait_ms, enable, i_A in steps:
        now_ms += wait_ms
        inverter.expire(now_ms * MS)
        if i_A is not None:
            inverter.command(now_ms * MS, i_A, enable)
            last_enable_ms = now_ms if enable else -1000
        if inverter.i_A != ZERO_A:
            assert now_ms - last_enable_ms < 50


def device(**table):
    return RegisterDevice(ModbusConfig(**table), -1.0, 1.0)


def test_registers_read_what_was_written_and_measured():
    brake = device()
    assert brake.write(0, [2500])
    brake.measure(25.5, DeviceStatus.FAULT)
    assert brake.setpoint == pytest.approx(0.25)
    assert brake.words("holding") == {0: 2500, 16: 2, 17: 255}
    assert brake.words("input") == {}
    assert brake.setpoint_addresses == range(1)


def test_input_registers_hold_status_and_value_if_the_bench_says_so():
    brake = device(read_table="input", status_register=0)
    assert brake.words("holding") == {0: 0}
    assert brake.words("input") == {0: 1, 17: 0}


def test_a_wide_set_point_may_be_written_in_two_parts():
    drive = device(setpoint_kind="i32", setpoint_scale=1e-6)
    assert drive.write(1, [500])
    assert drive.setpoint == pytest.approx(500e-6)
    assert drive.write(0, [0xFFFF])
    assert drive.setpoint == pytest.approx((500 - 65_536) * 1e-6)


def test_a_set_point_out_of_range_is_refused():
    brake = device()
    assert brake.write(0, [10_000])
    assert not brake.write(0, [10_001])
    assert brake.setpoint == pytest.approx(1.0)


def test_the_watchdog_drops_the_set_point():
    drive = device(watchdog_s=2.0)
    drive.write(0, [5000])
    drive.elapse(0)
    drive.elapse(2000 * MS - 1)
    assert drive.setpoint == pytest.approx(0.5)
    drive.elapse(1)
    drive.elapse(5000 * MS)
    assert (drive.setpoint, drive.words("holding")[0]) == (0.0, 0)


def test_without_a_watchdog_the_set_point_stays():
    brake = device()
    brake.write(0, [5000])
    brake.elapse(10**15)
    assert brake.setpoint == pytest.approx(0.5)


def test_a_measurement_that_is_not_a_number_reads_zero():
    brake = device()
    brake.measure(math.nan)
    assert brake.words("holding")[17] == 0
