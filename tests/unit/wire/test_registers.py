import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.config import ConfigError, ModbusConfig
from motord.config.reading import validate
from motord.wire.modbus.registers import DeviceStatus, Register, layout

KINDS = ("u16", "i16", "u32", "i32")
RANGES = {
    "u16": (0, 65_535),
    "i16": (-32_768, 32_767),
    "u32": (0, 4_294_967_295),
    "i32": (-2_147_483_648, 2_147_483_647),
}
registers = st.builds(
    Register,
    address=st.integers(0, 65_534),
    kind=st.sampled_from(KINDS),
    scale=st.floats(1e-6, 1e3),
    word_order=st.sampled_from(("big", "little")),
)


@pytest.mark.parametrize("kind", KINDS)
def test_counts_are_those_of_the_kind(kind):
    assert Register(0, kind, 1.0).counts == RANGES[kind]


@given(registers, st.floats())
def test_any_value_gives_words_that_fit(register, value):
    words = register.encode(value)
    assert len(words) == register.words
    assert all(0 <= word <= 0xFFFF for word in words)


@given(registers, st.floats(-1e9, 1e9))
def test_decode_gives_the_value_back_within_half_a_count_or_clamped(register, value):
    low, high = (count * register.scale for count in register.counts)
    expected = min(max(value, low), high)
    got = register.decode(register.encode(value))
    assert got == pytest.approx(expected, rel=1e-12, abs=register.scale * 0.5000001)


@given(registers, st.sampled_from((math.nan, math.inf, -math.inf)))
def test_what_is_not_finite_is_zero(register, value):
    assert register.encode(value) == [0] * register.words


@given(st.sampled_from(KINDS), st.data())
def test_every_count_survives(kind, data):
    count = data.draw(st.integers(*RANGES[kind]))
    register = Register(0, kind, 1.0)
    assert register.decode(register.encode(float(count))) == count


def test_known_words():
    assert Register(0, "u16", 0.0001).encode(0.5) == [5000]
    assert Register(0, "i16", 0.1).encode(-1.0) == [0xFFF6]
    assert Register(0, "i32", 1.0).encode(-2.0) == [0xFFFF, 0xFFFE]
    assert Register(0, "u32", 1.0).encode(65_536.0) == [1, 0]
    assert Register(0, "u32", 1.0, "little").encode(65_536.0) == [0, 1]


def test_layout_follows_the_config():
    table = layout(
        ModbusConfig(
            setpoint_register=3,
            setpoint_kind="i32",
            setpoint_scale=0.5,
            status_register=7,
            value_register=9,
            value_kind="u16",
            value_scale=0.25,
            word_order="little",
        )
    )
    assert table.setpoint == Register(3, "i32", 0.5, "little")
    assert table.status == Register(7, "u16", 1.0, "little")
    assert table.value == Register(9, "u16", 0.25, "little")


@given(st.integers(0, 3), st.integers(0, 15), st.integers(0, 15).filter(lambda bit: bit > 0))
def test_status_survives_any_masks(status, ready_bit, step):
    fault_bit = (ready_bit + step) % 16
    table = layout(ModbusConfig(status_ready_mask=1 << ready_bit, status_fault_mask=1 << fault_bit))
    word = table.status_word(DeviceStatus(status))
    assert table.decode_status(word) == DeviceStatus(status)


def test_a_device_without_a_ready_bit_is_ready():
    assert layout(ModbusConfig(status_ready_mask=0)).decode_status(0) == DeviceStatus.READY


def test_registers_that_overlap_are_refused(tmp_path):
    data = {"setpoint_register": 16, "setpoint_kind": "u32", "status_register": 17}
    with pytest.raises(ConfigError, match="both use register 17"):
        validate(ModbusConfig, tmp_path / "bench.toml", "", data)


def test_input_and_holding_registers_may_have_the_same_addresses():
    table = ModbusConfig(setpoint_register=16, status_register=16, read_table="input")
    assert table.status_register == 16
