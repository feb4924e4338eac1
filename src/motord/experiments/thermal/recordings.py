"""Heat-up and cooling as recordings have them: currents of the ticks, readings of the channels."""

from collections.abc import Sequence
from math import hypot, sqrt
from typing import Any

import numpy as np

from motord.config import AccuracyConfig
from motord.experiments.subject import (
    AnalysisError,
    Recordings,
    check_plan,
    plan_settings,
    require_columns,
)
from motord.experiments.thermal import NAME, ThermalConfig
from motord.experiments.thermal.course import CopperResistance, Readings, ThermalCourse
from motord.identification.operating_points import COMMANDS, CURRENTS, stacked
from motord.identification.signal_condition import CurrentProducts
from motord.recording.reader import Run

STEPS_MAX = 10_000
"""Steps that a course is cut into."""

STEP_MIN_S = 0.02

GAP_S = 5.0
"""Time without ticks that is bridged."""

READ = (
    "winding_channel", "magnet_channel", "housing_channel", "ambient_channel",
    "resistance_ohm", "resistance_C", "resistance_per_K",
)  # fmt: skip
"""Settings that the constants follow from."""

STOPPED = "stopped"
"""How a cooling ended that the plan did not end."""


def thermal_course(recordings: Recordings) -> tuple[ThermalCourse, CopperResistance]:
    """Return the course of the recordings, and what is known of the winding's resistance.

    Of several heat-ups the last counts. Raises AnalysisError, ConfigError, RecordError.
    """
    for run in recordings.runs:
        check_plan(run, NAME)
        require_columns(run, ("t_ns", *CURRENTS))
    runs = sorted(recordings.runs, key=_first_ns)
    own = plan_settings(recordings, NAME, ThermalConfig, *READ)
    heating, cooling = _points(runs)
    begin_ns = int(heating["t_start_ns"])
    end_ns = int(cooling["t_end_ns"]) if cooling else _last_ns(runs[-1])
    duration_s = (end_ns - begin_ns) * 1e-9
    step_s = max(duration_s / STEPS_MAX, STEP_MIN_S)
    squares_A2, current_ratios = _squares_A2(runs, begin_ns, step_s, int(duration_s / step_s))
    readings = {
        node: _readings(runs, f"{node}_channel", channel, begin_ns, end_ns)
        for node, channel in own.nodes.items()
    }
    ambient = None
    if own.ambient_channel:
        ambient = _readings(runs, "ambient_channel", own.ambient_channel, begin_ns, end_ns)
    course = ThermalCourse(
        step_s,
        squares_A2,
        readings,
        (int(heating["t_end_ns"]) - begin_ns) * 1e-9,
        (str(heating.get("ended_by", "")), str(cooling["ended_by"]) if cooling else STOPPED),
        ambient,
        current_ratios,
    )
    return course, copper_of(own, recordings.subject.accuracy)


def copper_of(own: ThermalConfig, accuracy: AccuracyConfig) -> CopperResistance:
    """Return what settings and accuracy say of the resistance; heat goes with the square."""
    known = own.resistance_ohm > 0
    uncertainty = hypot(own.resistance_tolerance, 0.02 * accuracy.current_gain_percent) / sqrt(3)
    return CopperResistance(
        own.resistance_ohm or 1.0, own.resistance_C, own.resistance_per_K, uncertainty, known
    )


def _points(runs: Sequence[Run]) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Return the last heat-up and the cooling after it, None if that was not ended."""
    points = sorted(
        (point for run in runs for point in run.operating_points()),
        key=lambda point: int(point["t_start_ns"]),
    )
    heatings = [point for point in points if int(point["index"]) == 0]
    if not heatings:
        raise AnalysisError(
            f"{runs[-1].path}: no heat-up was ended in it (the plan was stopped, or failed); "
            "`motord record info` says how; name all recordings of the plan, or heat up again"
        )
    after = [
        point
        for point in points
        if int(point["index"]) == 1 and int(point["t_start_ns"]) >= int(heatings[-1]["t_end_ns"])
    ]
    return heatings[-1], after[0] if after else None


def _first_ns(run: Run) -> int:
    for block in run.blocks(["t_ns"]):
        return int(block["t_ns"][0])
    raise AnalysisError(
        f"{run.path}: no ticks in it: the loop did not run; leave this recording out, or heat up "
        "again"
    )


def _last_ns(run: Run) -> int:
    last_ns = 0
    for block in run.blocks(["t_ns"]):
        last_ns = int(block["t_ns"][-1])
    return last_ns


def _squares_A2(
    runs: Sequence[Run], begin_ns: int, step_s: float, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the sum of the squares of the phase currents, mean over each step (k,).

    And the currents of each phase over those commanded (3,), nan where none were recorded.
    """
    total, number = np.zeros(steps), np.zeros(steps)
    products = CurrentProducts.of(*np.zeros((2, 1, 3)))
    end_ns = begin_ns + round(steps * step_s * 1e9)
    for run in runs:
        commands = COMMANDS if set(COMMANDS) <= set(run.columns) else ()
        columns = ["t_ns", *CURRENTS, *commands]
        for block in run.blocks(columns, from_ns=begin_ns, to_ns=end_ns):
            at = ((block["t_ns"].astype(np.int64) - begin_ns) * 1e-9 / step_s).astype(np.int64)
            sensed_A = stacked(block, CURRENTS)
            squares = (sensed_A**2).sum(axis=1)
            good = (at >= 0) & (at < steps) & np.isfinite(squares)
            total += np.bincount(at[good], squares[good], steps)
            number += np.bincount(at[good], minlength=steps)
            if commands:
                products += CurrentProducts.of(sensed_A[good], stacked(block, commands)[good])
    there = np.flatnonzero(number)
    edges = np.concatenate([[-1], there, [steps]])
    longest = int(np.argmax(np.diff(edges)))
    gap_s = float(np.diff(edges)[longest] - 1) * step_s
    if gap_s > GAP_S:
        at_s = (edges[longest] + 1) * step_s
        raise AnalysisError(
            f"{runs[-1].path}: no currents for {gap_s:.3g} s, {at_s:.0f} s after its beginning: "
            "the heat is not known; name all recordings of the plan, or heat up again"
        )
    return np.interp(np.arange(steps), there, total[there] / number[there]), products.ratios


def _readings(
    runs: Sequence[Run], setting: str, channel: str, begin_ns: int, end_ns: int
) -> Readings:
    """Return the readings of a channel within a time, of all recordings."""
    times, values = [], []
    for run in runs:
        known = run.channels()
        if channel not in known:
            raise AnalysisError(
                f'{run.path}: has no channel "{channel}" ({setting} of [plans.thermal]); it has '
                f"{', '.join(known) or 'none'}; name a bench file with -c that names one of them"
            )
        t_ns, value_C = run.channel(channel)
        times.append(t_ns)
        values.append(value_C)
    t_ns, first = np.unique(np.concatenate(times), return_index=True)
    value_C = np.concatenate(values)[first]
    inside = (t_ns >= begin_ns) & (t_ns <= end_ns)
    if not np.isfinite(value_C[inside]).any():
        raise AnalysisError(
            f'{runs[-1].path}: channel "{channel}" ({setting} of [plans.thermal]) has no valid '
            "reading in the heat-up; see its sensor, or name another channel in a file with -c"
        )
    return Readings(channel, (t_ns[inside] - begin_ns) * 1e-9, value_C[inside])
