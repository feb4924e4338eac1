from hypothesis import given
from hypothesis import strategies as st

from motord.wire.crc import crc8, crc16

CHECK = b"123456789"


def test_check_values_of_the_catalogue() -> None:
    assert crc8(CHECK) == 0x4B
    assert crc16(CHECK) == 0x29B1


def _bitwise(data: bytes, width: int, polynomial: int, start: int, final: int) -> int:
    crc, top = start, 1 << (width - 1)
    for byte in data:
        crc ^= byte << (width - 8)
        for _ in range(8):
            crc = (crc << 1) ^ polynomial if crc & top else crc << 1
        crc &= (1 << width) - 1
    return crc ^ final


@given(st.binary(max_size=64))
def test_equal_to_the_definition_bit_by_bit(data: bytes) -> None:
    assert crc8(data) == _bitwise(data, 8, 0x1D, 0xFF, 0xFF)
    assert crc16(data) == _bitwise(data, 16, 0x1021, 0xFFFF, 0)


@given(st.binary(min_size=1, max_size=64), st.data())
def test_any_single_bit_error_shows(data: bytes, draw: st.DataObject) -> None:
    bit = draw.draw(st.integers(0, 8 * len(data) - 1))
    spoilt = bytearray(data)
    spoilt[bit // 8] ^= 1 << bit % 8
    assert crc8(spoilt) != crc8(data)
    assert crc16(spoilt) != crc16(data)
