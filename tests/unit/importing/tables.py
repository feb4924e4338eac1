"""Recordings as other programs write them: small tables with a known torque."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from motord.importing.convert import Imported, import_run
from motord.recording.reader import Run, open_run

MOTOR = """\
[motor]
name = "bought"
pole_pairs = {pole_pairs}
slots = {slots}
counts = {counts}
rated_torque_Nm = 6.0
connection = "independent"
back_emf = [{{order = 1, amplitude_V_s_per_rad = 0.2}}]
"""

MAP = """\
motor = "motor.toml"
start = 2007-05-01T12:00:00Z
[columns]
t_s = "Time"
angle_rad = "Position[rad]"
torque_Nm = {column = "Iq", scale = 0.02}
"""

START_NS = 1_178_020_800_000_000_000


def write_motor(
    folder: Path, slots: int = 48, pole_pairs: int = 8, counts: int = 4096, more: str = ""
) -> Path:
    path = folder / "motor.toml"
    path.write_text(MOTOR.format(slots=slots, pole_pairs=pole_pairs, counts=counts) + more)
    return path


def turning(
    rows: int = 4000, speed_Hz: float = 1.0, rate_Hz: float = 1000.0
) -> dict[str, np.ndarray]:
    """A rotor that turns evenly, with a torque of 1.5 Nm and orders 48 and 16."""
    t_s = np.arange(rows) / rate_Hz
    angle_rad = 2 * np.pi * speed_Hz * t_s + 0.4
    torque_Nm = 1.5 + 0.3 * np.sin(48 * angle_rad + 0.3) + 0.1 * np.sin(16 * angle_rad + 0.5)
    return {"Time": t_s, "Position[rad]": angle_rad, "Iq": torque_Nm / 0.02}


def write_csv(
    path: Path,
    columns: Mapping[str, Sequence[float] | np.ndarray],
    delimiter: str = ",",
    decimal: str = ".",
    preamble: str = "",
    encoding: str = "utf-8",
    edit: Mapping[int, str] | None = None,
) -> Path:
    """Write a table; `edit` replaces rows, counted from 0."""
    line = delimiter.join(["%.7g"] * len(columns))
    values = (np.asarray(column).tolist() for column in columns.values())
    rows = [(line % row).replace(".", decimal) for row in zip(*values, strict=True)]
    for row, text in (edit or {}).items():
        rows[row] = text
    text = preamble + delimiter.join(columns) + "\n" + "\n".join(rows) + "\n"
    path.write_bytes(text.encode(encoding))
    return path


def imported(
    folder: Path,
    source: Path,
    map_text: str = MAP,
    *,
    strict: bool = False,
    few_rows: bool = False,
) -> tuple[Imported, Run]:
    """Import `source` with a map that lies next to it."""
    map_path = folder / "map.toml"
    map_path.write_text(map_text, encoding="utf-8")
    if not (folder / "motor.toml").exists():
        write_motor(folder)
    done = import_run(source, map_path, folder / "run.mcap", strict=strict, few_rows=few_rows)
    return done, open_run(folder / "run.mcap")
