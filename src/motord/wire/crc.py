"""The two checksums of the wires.

`crc8` is CRC-8/SAE-J1850 (polynomial 0x1D, start 0xFF, final 0xFF; check value 0x4B), as drives
use it in CAN payloads. `crc16` is CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF; check value
0x29B1) of the bridge's frames. Check value: the sum over the ASCII digits 123456789.
"""

from binascii import crc_hqx


def _table(polynomial: int) -> bytes:
    table = bytearray()
    for value in range(256):
        crc = value
        for _ in range(8):
            crc = (crc << 1) ^ polynomial if crc & 0x80 else crc << 1
        table.append(crc & 0xFF)
    return bytes(table)


_J1850 = _table(0x11D)


def crc8(data: bytes | bytearray) -> int:
    """Return CRC-8/SAE-J1850 of `data`."""
    crc = 0xFF
    table = _J1850
    for byte in data:
        crc = table[crc ^ byte]
    return crc ^ 0xFF


def crc16(data: bytes | bytearray) -> int:
    """Return CRC-16/CCITT-FALSE of `data`."""
    return crc_hqx(data, 0xFFFF)
