"""A shift at a test station: which lines are serial numbers to test, and what came of them."""

import re
from collections import Counter
from contextlib import suppress
from pathlib import Path

from motord.recording.file_names import STAMP
from motord.verdict.serial import NAME_MAX, SerialError, certificate_name, check_serial

DECISIONS = ("pass", "fail", "undecidable", "error")
"""What a test ends with; with an error nothing was decided."""

REPEAT_S = 5.0
"""Time after a test in which its serial number is taken to have been typed twice."""

_HEAD_BYTES = 4096
"""Of a certificate, within which its title ends."""

_TITLE = re.compile(rb": (pass|fail|undecidable)</title>")


class Shift:
    """The tests since the station was started; ended_s: when the last one was over, monotonic."""

    def __init__(self) -> None:
        self.counts = Counter(dict.fromkeys(DECISIONS, 0))
        self.ended_s = 0.0
        self._decisions: dict[str, str] = {}
        self._last = ""

    def serial_of(self, line: bytes, now_s: float) -> str:
        """Return the serial number that a line is. Raises SerialError if none is to be tested."""
        if len(line) > NAME_MAX:
            raise SerialError(f"the serial number is too long: at most {NAME_MAX} characters")
        try:
            serial = check_serial(line.decode())
        except UnicodeDecodeError:
            raise SerialError(f"the serial number is not text in UTF-8: {line!r}") from None
        if serial == self._last and now_s - self.ended_s < REPEAT_S:
            raise SerialError(
                f"{serial} has just been tested, so it was typed twice: wait {REPEAT_S:g} s to "
                "test it again"
            )
        return serial

    def earlier(self, serial: str) -> str:
        """Return what the last test of this serial number ended with, "" if there was none."""
        return self._decisions.get(serial, "")

    def add(self, serial: str, decision: str) -> None:
        """Count a test."""
        self.counts[decision] += 1
        self._decisions[serial] = decision
        self._last = serial

    def to_text(self) -> str:
        """Return the counts as a line."""
        each = ", ".join(f"{count} {decision}" for decision, count in self.counts.items())
        return f"{self.counts.total()} tested: {each}"


def earlier_verdict(folder: Path, motor_type: Path, serial: str) -> str:
    """Return decision and time of the newest certificate in a folder, "" if there is none."""
    before, after = certificate_name(motor_type, serial, "\0").split("\0")
    pattern = re.compile(f"{re.escape(before)}({STAMP}){re.escape(after)}")
    with suppress(OSError):
        names = sorted(path.name for path in folder.iterdir() if pattern.fullmatch(path.name))
        for name in reversed(names):
            with (folder / name).open("rb") as file:
                title = _TITLE.search(file.read(_HEAD_BYTES))
            if title is not None:
                t = name.removeprefix(before)
                when = f"{t[:4]}-{t[4:6]}-{t[6:8]} {t[9:11]}:{t[11:13]} UTC"
                return f"{title[1].decode()}, {when}"
    return ""
