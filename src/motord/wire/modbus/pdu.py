"""Modbus questions and their answers, as bytes: functions 3, 4, 6 and 16, framed for TCP or RTU.

Modbus over a serial line does not number its frames. So an answer is taken only if it can be the
answer to the question: unit, function, length, checksum and, for a write, what it echoes.
"""

import struct
from dataclasses import dataclass

READ_FUNCTIONS = {"holding": 3, "input": 4}
WRITE_ONE, WRITE_SEVERAL = 6, 16
REFUSED = 0x80

TCP_HEAD = struct.Struct(">HHHB")
"""Transaction, protocol (0), bytes that follow, unit."""


@dataclass(frozen=True)
class ModbusException:
    """The device answers with an exception."""

    code: int


Answer = list[int] | ModbusException
"""Registers read (none for a write), or why there are none."""


@dataclass(frozen=True)
class Question:
    """A request without its frame, and how its answer begins before `words` registers."""

    request: bytes
    beginning: bytes
    words: int

    @property
    def answer_bytes(self) -> int:
        """Return the length of an answer that is no refusal."""
        return len(self.beginning) + 2 * self.words

    def understand(self, pdu: bytes) -> Answer | None:
        """Return what an answer says, or None if it is none to this question."""
        if len(pdu) == 2 and pdu[0] == self.request[0] | REFUSED:
            return ModbusException(pdu[1])
        if len(pdu) != self.answer_bytes or not pdu.startswith(self.beginning):
            return None
        return list(struct.unpack(f">{self.words}H", pdu[len(self.beginning) :]))


def read(table: str, address: int, words: int) -> Question:
    """Return the question for registers of a table, "holding" or "input"."""
    function = READ_FUNCTIONS[table]
    return Question(
        struct.pack(">BHH", function, address, words), bytes([function, 2 * words]), words
    )


def write(address: int, words: list[int]) -> Question:
    """Return the question that writes holding registers."""
    if len(words) == 1:
        request = struct.pack(">BHH", WRITE_ONE, address, words[0])
        return Question(request, request, 0)
    head = struct.pack(">BHH", WRITE_SEVERAL, address, len(words))
    content = struct.pack(f">B{len(words)}H", 2 * len(words), *words)
    return Question(head + content, head, 0)


def tcp_frame(transaction: int, unit: int, question: Question) -> bytes:
    """Return the bytes of a question over TCP."""
    request = question.request
    return TCP_HEAD.pack(transaction, 0, len(request) + 1, unit) + request


def rtu_frame(unit: int, question: Question) -> bytes:
    """Return the bytes of a question on a serial line."""
    body = bytes([unit]) + question.request
    return body + crc16_modbus(body).to_bytes(2, "little")


def rtu_answer(heard: bytes, unit: int, question: Question) -> Answer | None:
    """Return the answer among all bytes heard since the question, or None if there is none yet.

    Noise, answers of other units and those to earlier questions are passed over.
    """
    for start in range(len(heard)):
        if heard[start] != unit:
            continue
        for size in (question.answer_bytes, 2):
            end = start + 1 + size
            if crc16_modbus(heard[start:end]).to_bytes(2, "little") != heard[end : end + 2]:
                continue
            answer = question.understand(heard[start + 1 : end])
            if answer is not None:
                return answer
    return None


def crc16_modbus(data: bytes) -> int:
    """Return the CRC-16/MODBUS of `data`: polynomial 0x8005 reflected, start 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc
