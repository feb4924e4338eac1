"""What certificates of earlier tests say of a motor."""

import re
from contextlib import suppress
from pathlib import Path

from motord.recording.file_names import STAMP
from motord.verdict.serial import certificate_name

_HEAD_BYTES = 4096
"""Of a certificate, within which its title ends."""

_TITLE = re.compile(rb": (pass|fail|undecidable)</title>")


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
