"""Recordings whose signals are wrong: one column of the ticks changed, all else as it was."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from motord.recording.reader import open_run
from motord.recording.writer import RunWriter

Change = Callable[[np.ndarray], np.ndarray]
"""From ticks (n,) to other ticks; it may change those that it is given."""

SEED = 7
BLOCK = 1000
"""Ticks that are written at a time."""

TORQUE, COUNT = "torque_Nm", "encoder_count"
CURRENTS = tuple(f"i_{phase}_A" for phase in "abc")
COMMANDS = tuple(f"i_cmd_{phase}_A" for phase in "abc")
VOLTAGES = tuple(f"u_{phase}_V" for phase in "abc")


def scaled(names: tuple[str, ...], factor: float, ticks: np.ndarray) -> np.ndarray:
    for name in names:
        ticks[name] *= factor
    return ticks


def shifted(names: tuple[str, ...], by: float, ticks: np.ndarray) -> np.ndarray:
    for name in names:
        ticks[name] += by
    return ticks


def swapped(names: tuple[str, ...], ticks: np.ndarray) -> np.ndarray:
    second = ticks[names[1]].copy()
    ticks[names[1]], ticks[names[2]] = ticks[names[2]].copy(), second
    return ticks


def late(names: tuple[str, ...], late_s: float, ticks: np.ndarray) -> np.ndarray:
    t_s = (ticks["t_ns"] - ticks["t_ns"][0]) * 1e-9
    for name in names:
        ticks[name] = np.interp(t_s - late_s, t_s, ticks[name].astype(float))
    return ticks


def mains(names: tuple[str, ...], part: float, ticks: np.ndarray) -> np.ndarray:
    t_s = (ticks["t_ns"] - ticks["t_ns"][0]) * 1e-9
    for name in names:
        ticks[name] += part * np.nanmax(np.abs(ticks[name])) * np.sin(2 * np.pi * 50 * t_s)
    return ticks


def spiked(names: tuple[str, ...], ticks: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(SEED)
    for name in names:
        at = rng.random(ticks.size) < 1e-3
        ticks[name][at] += rng.choice([-1, 1], at.sum()) * 2 * np.nanmax(np.abs(ticks[name]))
    return ticks


def frozen(names: tuple[str, ...], ticks: np.ndarray) -> np.ndarray:
    """Freeze the second and the seventh tenth of the recording."""
    for name in names:
        for tenth in (1, 6):
            part = slice(tenth * ticks.size // 10, (tenth + 1) * ticks.size // 10)
            ticks[name][part] = ticks[name][part.start]
    return ticks


def clipped(names: tuple[str, ...], ticks: np.ndarray) -> np.ndarray:
    for name in names:
        most = 0.8 * np.nanmax(np.abs(ticks[name]))
        ticks[name] = np.clip(ticks[name], -most, most)
    return ticks


def drifting(names: tuple[str, ...], part: float, ticks: np.ndarray) -> np.ndarray:
    for name in names:
        ticks[name] *= 1 + part * np.linspace(-1, 1, ticks.size)
    return ticks


def clock(factor: float, ticks: np.ndarray) -> np.ndarray:
    first = ticks["t_ns"][0]
    ticks["t_ns"] = first + np.round((ticks["t_ns"] - first) * factor).astype(np.int64)
    return ticks


def lost(part: float, ticks: np.ndarray) -> np.ndarray:
    return ticks[np.random.default_rng(SEED).random(ticks.size) >= part]


def gaps(ticks: np.ndarray) -> np.ndarray:
    """Lose 50 ms in each second."""
    t_s = (ticks["t_ns"] - ticks["t_ns"][0]) * 1e-9
    return ticks[t_s % 1.0 > 0.05]


def line_stuck(bit: int, ticks: np.ndarray) -> np.ndarray:
    ticks[COUNT] &= ~(1 << bit)
    return ticks


def turned(counts: int, ticks: np.ndarray) -> np.ndarray:
    ticks[COUNT] = (ticks[COUNT] + counts) % 4096
    return ticks


def backwards(ticks: np.ndarray) -> np.ndarray:
    ticks[COUNT] = 4095 - ticks[COUNT]
    return ticks


def misread(ticks: np.ndarray) -> np.ndarray:
    """Flip a random line in one of 500 samples."""
    rng = np.random.default_rng(SEED)
    at = np.flatnonzero(rng.random(ticks.size) < 2e-3)
    ticks[COUNT][at] ^= 1 << rng.integers(0, 12, at.size)
    return ticks


def out_of_range(ticks: np.ndarray) -> np.ndarray:
    """Make one sample in the middle of each point a count that no encoder of the bench has."""
    for point in np.unique(ticks["plan_point"][ticks["plan_point"] >= 0]):
        at = np.flatnonzero(ticks["plan_point"] == point)
        ticks[COUNT][at[at.size // 2]] = 65535
    return ticks


CHANGES: Mapping[str, Change] = {
    "torque * -1": partial(scaled, (TORQUE,), -1.0),
    "torque in mNm": partial(scaled, (TORQUE,), 1e3),
    "torque in kNm": partial(scaled, (TORQUE,), 1e-3),
    "torque * 2": partial(scaled, (TORQUE,), 2.0),
    "torque * 1.1": partial(scaled, (TORQUE,), 1.1),
    "torque + 0.5 Nm": partial(shifted, (TORQUE,), 0.5),
    "torque 20 ms late": partial(late, (TORQUE,), 0.02),
    "torque with mains 5 %": partial(mains, (TORQUE,), 0.05),
    "torque with spikes": partial(spiked, (TORQUE,)),
    "torque frozen at times": partial(frozen, (TORQUE,)),
    "torque clipped": partial(clipped, (TORQUE,)),
    "torque's gain drifts 10 %": partial(drifting, (TORQUE,), 0.05),
    "currents in mA": partial(scaled, CURRENTS, 1e3),
    "currents as RMS": partial(scaled, CURRENTS, 0.5**0.5),
    "currents * -1": partial(scaled, CURRENTS, -1.0),
    "current of a * -1": partial(scaled, CURRENTS[:1], -1.0),
    "current of a * 1.2": partial(scaled, CURRENTS[:1], 1.2),
    "current of a + 2 A": partial(shifted, CURRENTS[:1], 2.0),
    "currents of b and c swapped": partial(swapped, CURRENTS),
    "currents 10 ms late": partial(late, CURRENTS, 0.01),
    "currents with spikes": partial(spiked, CURRENTS),
    "current of a frozen at times": partial(frozen, CURRENTS[:1]),
    "currents clipped": partial(clipped, CURRENTS),
    "voltages * 0.5": partial(scaled, VOLTAGES, 0.5),
    "voltages * -1": partial(scaled, VOLTAGES, -1.0),
    "voltage of a * 1.2": partial(scaled, VOLTAGES[:1], 1.2),
    "voltages of b and c swapped": partial(swapped, VOLTAGES),
    "voltages 5 ms late": partial(late, VOLTAGES, 0.005),
    "voltages with mains 5 %": partial(mains, VOLTAGES, 0.05),
    "bus voltage * 0.5": partial(scaled, ("u_bus_V",), 0.5),
    "clock 2 % fast": partial(clock, 1.02),
    "clock twice as fast": partial(clock, 2.0),
    "a tenth of the ticks lost": partial(lost, 0.1),
    "50 ms lost in each second": gaps,
    "line 0 of the encoder stuck": partial(line_stuck, 0),
    "line 6 of the encoder stuck": partial(line_stuck, 6),
    "line 11 of the encoder stuck": partial(line_stuck, 11),
    "encoder turned by a quarter period": partial(turned, 128),
    "encoder turned by 5 deg el": partial(turned, 7),
    "encoder backwards": backwards,
    "encoder misread at times": misread,
    "encoder out of range at times": out_of_range,
}


def change_recording(source: Path, path: Path, change: Change) -> Path:
    """Write a recording with other ticks, and return its path."""
    run = open_run(source)
    ticks = change(run.ticks().copy())
    with RunWriter(path, run.metadata) as writer:
        for first in range(0, ticks.size, BLOCK):
            writer.ticks(ticks[first : first + BLOCK])
        for name, channel in run.channels().items():
            for t_ns, value in zip(*run.channel(name), strict=True):
                content = {"value": float(value), "raw": float(value), "status": "ok"}
                writer.channel(int(t_ns), name, channel.unit, channel.timeout_s, content)
        for point in run.operating_points():
            writer.operating_point(int(point["t_ns"]), point)
    return path
