"""Modbus requests and their responses, as bytes: functions 3, 4, 6 and 16, framed for TCP or RTU.

Modbus over a serial line does not number its frames. So a response is taken only if it can be the
response to the request: unit, function, length, checksum and, for a write, what it echoes.
"""

import struct
from dataclasses import dataclass

READ_FUNCTIONS = {"holding": 3, "input": 4}
WRITE_ONE, WRITE_SEVERAL = 6, 16
EXCEPTION = 0x80

TCP_HEAD = struct.Struct(">HHHB")
"""Transaction, protocol (0), bytes that follow, unit."""


@dataclass(frozen=True)
class ModbusException:
    """The device responded with an exception."""

    code: int


ModbusResponse = list[int] | ModbusException
"""Registers read (none for a write), or why there are none."""


@dataclass(frozen=True)
class ModbusRequest:
    """A request without its frame, and how its response begins before `words` registers."""

    pdu: bytes
    beginning: bytes
    words: int

    @property
    def response_bytes(self) -> int:
        """Return the length of a response that is no exception."""
        return len(self.beginning) + 2 * self.words

    def decode(self, pdu: bytes) -> ModbusResponse | None:
        """Return what a response has, or None if it is none to this request."""
        if len(pdu) == 2 and pdu[0] == self.pdu[0] | EXCEPTION:
            return ModbusException(pdu[1])
        if len(pdu) != self.response_bytes or not pdu.startswith(self.beginning):
            return None
        return list(struct.unpack(f">{self.words}H", pdu[len(self.beginning) :]))


def read(table: str, address: int, words: int) -> ModbusRequest:
    """Return the request for registers of a table, "holding" or "input"."""
    function = READ_FUNCTIONS[table]
    return ModbusRequest(
        struct.pack(">BHH", function, address, words), bytes([function, 2 * words]), words
    )


def write(address: int, words: list[int]) -> ModbusRequest:
    """Return the request that writes holding registers."""
    if len(words) == 1:
        pdu = struct.pack(">BHH", WRITE_ONE, address, words[0])
        return ModbusRequest(pdu, pdu, 0)
    head = struct.pack(">BHH", WRITE_SEVERAL, address, len(words))
    content = struct.pack(f">B{len(words)}H", 2 * len(words), *words)
    return ModbusRequest(head + content, head, 0)


def tcp_frame(transaction: int, unit: int, request: ModbusRequest) -> bytes:
    """Return the bytes of a request over TCP."""
    pdu = request.pdu
    return TCP_HEAD.pack(transaction, 0, len(pdu) + 1, unit) + pdu


def rtu_frame(unit: int, request: ModbusRequest) -> bytes:
    """Return the bytes of a request on a serial line."""
    body = bytes([unit]) + request.pdu
    return body + crc16_modbus(body).to_bytes(2, "little")


def rtu_response(received: bytes, unit: int, request: ModbusRequest) -> ModbusResponse | None:
    """Return the response among all bytes since the request, or None if there is none yet.

    Noise, responses of other units and those to earlier requests are passed over.
    """
    for start in range(len(received)):
        if received[start] != unit:
            continue
        for size in (request.response_bytes, 2):
            end = start + 1 + size
            if crc16_modbus(received[start:end]).to_bytes(2, "little") != received[end : end + 2]:
                continue
            response = request.decode(received[start + 1 : end])
            if response is not None:
                return response
    return None


def crc16_modbus(data: bytes) -> int:
    """Return the CRC-16/MODBUS of `data`: polynomial 0x8005 reflected, start 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc
