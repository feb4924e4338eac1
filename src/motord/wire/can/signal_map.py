"""Which signal of the bench's map stands for which value of the drive's messages."""

from collections.abc import Sequence

from motord.config import CanSignalMap
from motord.wire.can.codec import (
    COMMAND_SLOTS,
    DQ_COMMAND_SLOTS,
    DQ_FEEDBACK_SLOTS,
    FEEDBACK_SLOTS,
)


def command_names(signals: CanSignalMap) -> list[tuple[str, str, str]]:
    """Return slot, key of the map and name of every signal of the command that is mapped."""
    if not signals.rotating:
        rows = [("command_i_A", name) for name in signals.command_i_A]
        slots: tuple[str, ...] = COMMAND_SLOTS
    else:
        rows = [(key, getattr(signals, key)) for key in ("command_i_d_A", "command_i_q_A")]
        slots = DQ_COMMAND_SLOTS
    rows.append(("command_enable", signals.command_enable))
    return _mapped(slots, rows)


def feedback_names(signals: CanSignalMap) -> list[tuple[str, str, str]]:
    """Return slot, key of the map and name of every signal of the feedback that is mapped."""
    nothing = ("", "", "")
    rows = [("feedback_i_A", name) for name in signals.feedback_i_A or nothing]
    rows += [("feedback_u_V", name) for name in signals.feedback_u_V or nothing]
    slots = FEEDBACK_SLOTS[6:] + DQ_FEEDBACK_SLOTS
    rows += [(f"feedback_{slot}", getattr(signals, f"feedback_{slot}")) for slot in slots]
    return _mapped(FEEDBACK_SLOTS + DQ_FEEDBACK_SLOTS, rows)


def _mapped(slots: Sequence[str], rows: list[tuple[str, str]]) -> list[tuple[str, str, str]]:
    return [(slot, *row) for slot, row in zip(slots, rows, strict=True) if row[1]]
