"""Installed calibrations on disk: `<state folder>/calibrations/<bench>/<id>.json`.

The file `installed` there names the one in force. What it asks for at zero torque is checked first.
"""

import math
import os
import stat
import threading
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from motord import calibration
from motord.api.messages import CalibrationView
from motord.api.requests import max_calibration_bytes
from motord.atomic_write import write_whole
from motord.calibration import Calibration, CalibrationError
from motord.config import Config, MotorConfig
from motord.control import parameters
from motord.identification.least_loss import TINY_V2_S2, currents_per_Nm
from motord.service.host.events import EventLog
from motord.untrusted import read_text

MARK = "installed"


def state_directory() -> Path:
    """Return the folder of the daemon's persistent state.

    `$STATE_DIRECTORY` under systemd, else `$XDG_STATE_HOME/motord` or `~/.local/state/motord`.
    """
    given = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    if given:
        return Path(given)
    home = os.environ.get("XDG_STATE_HOME", "")
    return (Path(home) if home else Path.home() / ".local" / "state") / "motord"


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


GAIN_MAX = 4.0
"""Gains beyond it, or below its inverse, are those of a wrong unit or wire, not of a sensor."""


def check_rest_currents(calibration: Calibration, config: Config) -> None:
    """Raise CalibrationError if the bench must not be compensated so.

    At zero torque no phase may be asked for more than limits.i2t_current_A, what may flow for ever,
    or limits.current_A; alpha delta_epsilon is to be within 1 / GAIN_MAX and GAIN_MAX.
    """
    for phase, alpha in zip("abc", calibration.alpha, strict=True):
        gain = alpha * calibration.delta_epsilon
        if not 1 / GAIN_MAX <= gain <= GAIN_MAX:
            raise CalibrationError(
                f"calibration {calibration.id}: alpha_{phase} delta_epsilon = {gain:.3g} is "
                f"outside {1 / GAIN_MAX:g} to {GAIN_MAX:g}; check the units of currents and "
                "torque in the bench file, and calibrate again"
            )
    currents_A = rest_currents_A(calibration, config)
    limits = config.limits
    name = min(("i2t_current_A", "current_A"), key=lambda one: float(getattr(limits, one)))
    worst, allowed_A = int(np.argmax(currents_A)), float(getattr(limits, name))
    if not currents_A[worst] <= allowed_A:
        raise CalibrationError(
            f"calibration {calibration.id} would ask for up to {currents_A[worst]:.3g} A in phase "
            f"{'abc'[worst]} at zero torque, for offsets and cogging torque; [limits] {name} = "
            f"{allowed_A:g}"
        )


def rest_currents_A(calibration: Calibration, config: Config) -> np.ndarray:
    """Return the largest current (3,) of each phase over the turn, with all compensation and less.

    As `control.step` makes them, but for its limits; not by its compiled functions: to load the
    compiler would hold up the supervisor.
    """
    gain = np.array(calibration.alpha) * calibration.delta_epsilon
    beta_A = np.array(calibration.beta_A)
    asked_A = []
    for torque_Nm in (np.zeros(config.motor.counts), -np.array(calibration.tau_cog_Nm)):
        if config.inverter.q_only:
            asked_A.append(_along_q_A(config, torque_Nm, gain, beta_A))
            asked_A.append(_along_q_A(config, torque_Nm, np.ones(3), np.zeros(3)))
        else:
            flowing_A = torque_Nm[:, None] * currents_per_Nm(config.motor)
            asked_A += [(flowing_A - beta_A) / gain, flowing_A]
    largest_A: np.ndarray = np.abs(asked_A).max(axis=(0, 1))
    return largest_A


def _along_q_A(
    config: Config, torque_Nm: np.ndarray, gain: np.ndarray, beta_A: np.ndarray
) -> np.ndarray:
    """Return the currents (n, 3) along q that make torques (n,), as `currents_along_q` does."""
    built, k, *_ = parameters.build(config)
    p = built[0]
    electrical_rad = 2 * math.pi * p.pole_pairs * np.arange(len(k)) / len(k) + p.axes_rad
    alpha, across = -np.sin(electrical_rad), p.axes_sequence * np.cos(electrical_rad)
    across = across * math.sqrt(3) / 2
    x = np.stack([alpha, across - alpha / 2, -across - alpha / 2], axis=1)
    m = k - (k @ gain / gain.sum())[:, None]
    torque_per_A = (m * x) @ gain
    fit = torque_per_A**2 > TINY_V2_S2
    i_q_A = np.divide(torque_Nm - m @ beta_A, torque_per_A, out=np.zeros(len(k)), where=fit)
    return np.asarray(x * i_q_A[:, None])
