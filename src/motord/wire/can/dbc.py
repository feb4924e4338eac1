"""From a DBC file and the signal map of the bench to the drive's codec, once at start.

Every name that the DBC does not have, and every signal that cannot do what the map asks of it, is
one `ConfigError` that names the DBC, the key of the map and what the DBC has instead.
"""

import difflib
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cantools
from cantools.database.can import Database, Message, Signal
from cantools.database.errors import Error as DatabaseError

from motord.config import CanConfig, CanSignalMap, ConfigError
from motord.untrusted import read_text
from motord.wire.can.codec import (
    COMMAND_SLOTS,
    DQ_COMMAND_SLOTS,
    DQ_FEEDBACK_SLOTS,
    FEEDBACK_SLOTS,
    Checks,
    InverterCodec,
    MessageCodec,
)
from motord.wire.can.frame_format import CLASSIC_BYTES, EXTENDED, FD_BYTES
from motord.wire.can.signal import FLOAT_BITS, SignalCodec

_WHOLE_BITS = sys.float_info.mant_dig
_WHOLE = f"integer without scale, of {_WHOLE_BITS} bits at most"


def load(can: CanConfig) -> InverterCodec:
    """Compile the messages of `[inverter.can]`. Raises ConfigError."""
    codec = compile_codec(read_database(can.dbc), can.dbc, can.signals)
    for message in (codec.command, *codec.feedback):
        if message.size_bytes > CLASSIC_BYTES and not can.fd:
            raise ConfigError(
                f"{can.dbc}: {message.name} has {message.size_bytes} bytes, more than classical "
                "CAN carries; set fd = true in [inverter.can], or take another DBC"
            )
    return codec


def read_database(path: Path) -> Database:
    """Parse a DBC file. Raises ConfigError."""
    try:
        text = read_text(path, "cp1252", "replace")
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the DBC: {error.strerror}") from error
    try:
        database = cantools.database.load_string(text, "dbc")
    except DatabaseError as error:
        reason = str(getattr(error, "e_dbc", None) or error).replace("\n", " ")
        raise ConfigError(f"{path}: not a valid DBC: {reason}") from error
    assert isinstance(database, Database)
    return database


def signal_codec(path: Path, name: str) -> MessageCodec:
    """Compile the message of one signal, `Message.Signal`, with its value alone.

    Raises ConfigError.
    """
    message, signal = _Names(read_database(path), path, "").find("signal", name)
    return _Draft(message, {name: SignalCodec(signal, message.length)}).compiled()


def compile_codec(database: Database, path: Path, signals: CanSignalMap) -> InverterCodec:
    """Compile the mapped signals of `database`; `path` is for messages. Raises ConfigError."""
    names = _Names(database, path)
    commands = _Drafts(names)
    for slot, key, name in _command_names(signals):
        commands.add(slot, key, name)
    if len(commands.drafts) > 1:
        raise names.error(
            "command_enable" if signals.command_enable else "command_i_q_A",
            "currents and enable must be in one message, they are in "
            + " and ".join(commands.drafts),
        )
    commands.count("command_counter", signals.command_counter)
    commands.guard("command_crc", signals.command_crc)
    for name, value in signals.command_constants.items():
        commands.fix("command_constants", name, value)

    feedback = _Drafts(names)
    for slot, key, name in _feedback_names(signals):
        feedback.add(slot, key, name)
    for name in signals.feedback_counter:
        feedback.count("feedback_counter", name)
    for name in signals.feedback_crc:
        feedback.guard("feedback_crc", name)
    return InverterCodec(commands.compiled()[0], feedback.compiled(), signals)


def _command_names(signals: CanSignalMap) -> list[tuple[str, str, str]]:
    """Return slot, key of the map and name of every signal of the command that is mapped."""
    if not signals.rotating:
        rows = [("command_i_A", name) for name in signals.command_i_A]
        slots: tuple[str, ...] = COMMAND_SLOTS
    else:
        rows = [(key, getattr(signals, key)) for key in ("command_i_d_A", "command_i_q_A")]
        slots = DQ_COMMAND_SLOTS
    rows.append(("command_enable", signals.command_enable))
    return _mapped(slots, rows)


def _feedback_names(signals: CanSignalMap) -> list[tuple[str, str, str]]:
    """Return slot, key of the map and name of every signal of the feedback that is mapped."""
    nothing = ("", "", "")
    rows = [("feedback_i_A", name) for name in signals.feedback_i_A or nothing]
    rows += [("feedback_u_V", name) for name in signals.feedback_u_V or nothing]
    slots = FEEDBACK_SLOTS[6:] + DQ_FEEDBACK_SLOTS
    rows += [(f"feedback_{slot}", getattr(signals, f"feedback_{slot}")) for slot in slots]
    return _mapped(FEEDBACK_SLOTS + DQ_FEEDBACK_SLOTS, rows)


def _mapped(slots: Sequence[str], rows: list[tuple[str, str]]) -> list[tuple[str, str, str]]:
    return [(slot, *row) for slot, row in zip(slots, rows, strict=True) if row[1]]


def _cycle_s(message: Message) -> float:
    """Return the time between two of a cyclic message, by its own GenMsgCycleTime; 0 without one.

    The default that a DBC has for all messages says nothing of this one. 1 ms, the least that the
    attribute can hold, is what faster messages have, too.
    """
    stated = message.dbc.attributes.get("GenMsgCycleTime") if message.dbc is not None else None
    try:
        cycle_s = 1e-3 * float(stated.value) if stated is not None else 0.0
    except (TypeError, ValueError):
        return 0.0
    cyclic = "cycl" in str(message.send_type or "cyclic").lower()
    return cycle_s if cyclic and 1e-3 < cycle_s < math.inf else 0.0


@dataclass
class _Draft:
    """A message on its way to a codec."""

    message: Message
    signals: dict[str, SignalCodec] = field(default_factory=dict)
    checks: Checks = field(default_factory=Checks)
    constants: list[tuple[SignalCodec, float]] = field(default_factory=list)

    def compiled(self) -> MessageCodec:
        message = self.message
        key = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
        parts = (message.name, key, message.length, self.signals, self.checks, self.constants)
        return MessageCodec(*parts, cycle_s=_cycle_s(message))


class _Drafts:
    """The messages of one direction; those that carry a mapped value, and nothing else."""

    def __init__(self, names: "_Names") -> None:
        self._names = names
        self.drafts: dict[str, _Draft] = {}

    def add(self, slot: str, key: str, name: str) -> None:
        message, signal = self._names.find(key, name)
        if slot in ("enable", "status") and not _is_whole(signal):
            raise self._names.error(key, f"{name} must be an {_WHOLE}")
        draft = self.drafts.setdefault(message.name, _Draft(message))
        draft.signals[slot] = SignalCodec(signal, message.length)

    def count(self, key: str, name: str) -> None:
        if not name:
            return
        draft, signal = self._existing(key, name)
        counter = SignalCodec(signal, draft.message.length)
        if signal.is_signed or not _is_whole(signal):
            raise self._names.error(key, f"{name} must be an unsigned {_WHOLE}")
        least, greatest = map(int, counter.steps[:2])
        values = greatest - least + 1
        draft.checks = replace(
            draft.checks, counter=counter, counter_least=least, counter_modulus=values
        )

    def guard(self, key: str, name: str) -> None:
        if not name:
            return
        draft, signal = self._existing(key, name)
        first_bit = 0 if signal.byte_order == "little_endian" else 7
        if signal.length != 8 or signal.start % 8 != first_bit:
            raise self._names.error(key, f"{name} must be one whole byte, for a CRC-8/SAE-J1850")
        draft.checks = replace(draft.checks, crc_byte=signal.start // 8)

    def fix(self, key: str, name: str, value: float) -> None:
        draft, signal = self._existing(key, name)
        codec = SignalCodec(signal, draft.message.length)
        low, high, _ = codec.steps
        if not low <= value <= high:
            raise self._names.error(key, f"{name} = {value:g} is beyond {low:g} to {high:g}")
        draft.constants.append((codec, value))

    def compiled(self) -> tuple[MessageCodec, ...]:
        return tuple(draft.compiled() for draft in self.drafts.values())

    def _existing(self, key: str, name: str) -> tuple[_Draft, Signal]:
        message, signal = self._names.find(key, name)
        if message.name not in self.drafts:
            known = " and ".join(self.drafts)
            raise self._names.error(
                key, f"{name} is not in {known}, which the rest of the map uses"
            )
        return self.drafts[message.name], signal


def _is_whole(signal: Signal) -> bool:
    """Return whether every bit of its raw value is kept: values of all signals are floats."""
    whole = not signal.is_float and (signal.scale, signal.offset) == (1, 0)
    return whole and bool(signal.length <= _WHOLE_BITS)


class _Names:
    """Finds `Message.Signal` in a database; what it lacks becomes a ConfigError."""

    def __init__(
        self, database: Database, path: Path, table: str = "[inverter.can.signals] "
    ) -> None:
        self._path = path
        self._table = table
        self._messages = {message.name: message for message in database.messages}

    def error(self, key: str, what: str) -> ConfigError:
        return ConfigError(f"{self._path}: {self._table}{key}: {what}")

    def find(self, key: str, name: str) -> tuple[Message, Signal]:
        message_name, dot, signal_name = name.partition(".")
        if not dot:
            raise self.error(key, f'"{name}" must be written "Message.Signal"')
        message = self._messages.get(message_name)
        if message is None:
            known = _near(message_name, self._messages)
            raise self.error(key, f"the DBC has no message {message_name}; {known}")
        if message.length > FD_BYTES:
            what = f"{message_name} has {message.length} bytes, a CAN FD frame {FD_BYTES} at most"
            raise self.error(key, what)
        signals = {signal.name: signal for signal in message.signals}
        signal = signals.get(signal_name)
        if signal is None:
            known = _near(signal_name, signals)
            raise self.error(key, f"message {message_name} has no signal {signal_name}; {known}")
        if signal.multiplexer_ids:
            raise self.error(key, f"{name} is multiplexed, which motord does not support")
        if not signal.scale or not math.isfinite(signal.scale) or not math.isfinite(signal.offset):
            what = f"a factor of {signal.scale:g} and an offset of {signal.offset:g}"
            raise self.error(key, f"{name} has {what}, so that it says nothing")
        if signal.is_float and signal.length not in FLOAT_BITS:
            raise self.error(key, f"{name} is a floating-point number of {signal.length} bits")
        return message, signal


def _near(name: str, names: Iterable[str]) -> str:
    known = list(names)
    near = difflib.get_close_matches(name, known, 3, 0.5)
    if near:
        return f"did you mean {' or '.join(near)}?"
    return (
        f"it has {', '.join(known[:8])}{', ...' if len(known) > 8 else ''}"
        if known
        else "it has none"
    )
