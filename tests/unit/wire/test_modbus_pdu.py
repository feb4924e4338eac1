import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.wire.modbus.pdu import (
    ModbusException,
    crc16_modbus,
    read,
    rtu_frame,
    rtu_response,
    tcp_frame,
    write,
)

words = st.lists(st.integers(0, 0xFFFF), min_size=1, max_size=2)
units = st.integers(1, 247)


def framed(unit: int, pdu: bytes) -> bytes:
    body = bytes([unit]) + pdu
    return body + crc16_modbus(body).to_bytes(2, "little")


def registers(function: int, values: list[int]) -> bytes:
    return struct.pack(f">BB{len(values)}H", function, 2 * len(values), *values)


def test_check_value_of_the_crc() -> None:
    assert crc16_modbus(b"123456789") == 0x4B37


def test_requests_of_the_specification() -> None:
    """The examples of MODBUS Application Protocol Specification V1.1b3, 6.3, 6.4, 6.6, 6.12."""
    assert read("holding", 0x6B, 3).pdu == bytes.fromhex("03006b0003")
    assert read("input", 8, 1).pdu == bytes.fromhex("0400080001")
    assert write(1, [3]).pdu == bytes.fromhex("0600010003")
    assert write(1, [0x000A, 0x0102]).pdu == bytes.fromhex("100001000204000a0102")


def test_answers_of_the_specification() -> None:
    answer = bytes.fromhex("0306022b00000064")
    assert read("holding", 0x6B, 3).decode(answer) == [0x022B, 0, 0x64]
    assert write(1, [3]).decode(bytes.fromhex("0600010003")) == []
    assert write(1, [0x000A, 0x0102]).decode(bytes.fromhex("1000010002")) == []
    assert read("input", 8, 1).decode(bytes.fromhex("8402")) == ModbusException(2)


def test_frames() -> None:
    assert tcp_frame(0x1234, 17, write(1, [3])) == bytes.fromhex("123400000006110600010003")
    assert rtu_frame(17, read("holding", 0x6B, 3)) == bytes.fromhex("1103006b00037687")


@given(unit=units, value=st.integers(0, 0xFFFF), other=st.integers(0, 0xFFFF), at=st.integers(0, 9))
def test_only_the_echo_of_a_write_answers_it(unit: int, value: int, other: int, at: int) -> None:
    echo = framed(unit, write(at, [other]).pdu)
    answer = rtu_response(echo, unit, write(4, [value]))
    assert (answer == []) == ((at, other) == (4, value))
    assert answer in ([], None)


@given(unit=units, values=words, earlier=words, noise=st.binary(max_size=12))
def test_the_answer_is_found_behind_everything_else(
    unit: int, values: list[int], earlier: list[int], noise: bytes
) -> None:
    question = read("input", 5, len(values))
    before = noise + framed(unit, registers(3, earlier)) + framed(unit % 247 + 1, b"\x84\x02")
    assert rtu_response(before, unit, question) is None
    assert rtu_response(before + framed(unit, registers(4, values)), unit, question) == values


@given(unit=units, values=words, cut=st.integers(1, 6))
def test_part_of_an_answer_is_none(unit: int, values: list[int], cut: int) -> None:
    question = read("holding", 0, len(values))
    assert rtu_response(framed(unit, registers(3, values))[:-cut], unit, question) is None


@given(unit=units, values=words, bit=st.integers(0, 71))
def test_an_answer_with_a_wrong_bit_is_none(unit: int, values: list[int], bit: int) -> None:
    good = framed(unit, registers(3, values))
    bad = bytearray(good)
    bad[bit // 8 % len(good)] ^= 1 << bit % 8
    assert rtu_response(bytes(bad), unit, read("holding", 0, len(values))) is None


@pytest.mark.parametrize("code", [1, 6, 255])
def test_a_refusal_of_another_function_is_no_answer(code: int) -> None:
    question = write(0, [1])
    assert rtu_response(framed(3, bytes([0x86, code])), 3, question) == ModbusException(code)
    assert rtu_response(framed(3, bytes([0x83, code])), 3, question) is None
