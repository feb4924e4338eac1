"""Installed calibrations on disk: `<state folder>/calibrations/<bench>/<id>.json`.

The file `installed` there names the one in force.
"""

import os
import stat
import threading
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from motord import calibration
from motord.api.messages import CalibrationView
from motord.api.requests import max_calibration_bytes
from motord.atomic_write import write_whole
from motord.calibration import Calibration, CalibrationError
from motord.config import Config, MotorConfig
from motord.process.home_folder import in_home
from motord.service.bench.rest_currents import check_rest_currents
from motord.service.host.events import EventLog
from motord.untrusted import read_text

MARK = "installed"


def state_directory() -> Path:
    """Return the folder of the daemon's persistent state.

    `$STATE_DIRECTORY` under systemd, else `$XDG_STATE_HOME/motord` or `~/.local/state/motord`.
    Raises OSError for a user without a home.
    """
    given = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    if given:
        return Path(given)
    return in_home("XDG_STATE_HOME", ".local", "state") / "motord"


def check_given(
    motor: MotorConfig, content: dict[str, Any] | None, path: str | None
) -> Calibration:
    """Return the calibration from a file's content or from a file, for `motor`.

    Raises CalibrationError.
    """
    if path is None:
        given = calibration.from_json(content, "calibration")
    elif Path(path).is_absolute():
        given = calibration.load(_readable(Path(path), max_calibration_bytes(motor.counts)))
    else:
        raise CalibrationError(f"{path}: give an absolute path on the daemon's machine")
    given.check_motor(motor)
    return given


def _readable(path: Path, max_bytes: int) -> Path:
    """Return `path` if it is a file of a size that a calibration has. Raises CalibrationError."""
    try:
        status = path.stat()
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise CalibrationError(f"{path}: cannot read it: {why}") from None
    if not stat.S_ISREG(status.st_mode) or status.st_size > max_bytes:
        raise CalibrationError(
            f"{path}: no file of a calibration: {status.st_size} bytes, at most {max_bytes}"
        )
    return path


class CalibrationStore:
    """The calibrations of one bench on disk. Every method raises CalibrationError."""

    def __init__(self, config: Config, directory: Path) -> None:
        self._config = config
        self.directory = directory / "calibrations" / config.bench.name
        self.path = Path()
        self.current: Calibration | None = None
        self._saving = threading.Lock()

    def current_id(self) -> str:
        """Return the id of the calibration in force, "" if there is none; for any thread."""
        current = self.current
        return current.id if current is not None else ""

    def file(self) -> Path | None:
        """Return the file of the calibration in force, None until it is written; any thread."""
        current, path = self.current, self.path
        return path if current is not None and path.stem == current.id else None

    def accepted_findings(self) -> list[str]:
        """Return the names of the serious findings of the calibration in force."""
        return self.current.serious_names if self.current is not None else []

    def metadata(self) -> dict[str, object]:
        """Return what a recording says of the calibration in force."""
        return {"calibration": self.current_id(), "calibration_findings": self.accepted_findings()}

    def load_installed(self) -> Calibration | None:
        """Load the calibration that was in force when the daemon last ran, if there is one."""
        try:
            name = read_text(self.directory / MARK, errors="replace").strip()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise CalibrationError(f"{self.directory / MARK}: {error.strerror}") from error
        path = self.directory / name
        loaded = calibration.load(path)
        loaded.check_motor(self._config.motor)
        check_rest_currents(loaded, self._config)
        self.path, self.current = path, loaded
        return loaded

    def save(self, checked: Calibration) -> Path:
        """Write a checked calibration; mark it if it is still the one in force. For any thread."""
        path = self.directory / f"{checked.id}.json"
        with self._saving:
            try:
                self.directory.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise CalibrationError(f"{self.directory}: {error.strerror}") from error
            checked.save(path)
            if self.current_id() == checked.id:
                self._mark(path.name)
                self.path = path
        return path

    def _mark(self, name: str) -> None:
        mark = self.directory / MARK
        try:
            write_whole(mark, name + "\n")
        except OSError as error:
            raise CalibrationError(f"{mark}: cannot write it: {error.strerror}") from error

    def view(self) -> CalibrationView | None:
        """Return the calibration in force as published."""
        if self.current is None:
            return None
        now = datetime.now(UTC)
        return CalibrationView(
            id=self.current.id,
            created=self.current.created.isoformat(),
            age_s=self.current.age_s(now),
            age=self.current.age(now),
            method=self.current.method,
            path=str(self.file() or ""),
            findings=self.accepted_findings(),
        )


def announce(events: EventLog, installed: Calibration, how: str) -> None:
    """Emit that a calibration is in force now, `how`, and which serious findings it has."""
    accepted = installed.serious_names
    in_spite = f" in spite of {', '.join(accepted)}" if accepted else ""
    text = f"{installed.id} {how}{in_spite}"
    events.emit("calibration", text, id=installed.id, findings=accepted)
