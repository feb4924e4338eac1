"""Departures where the torque sensor passes the mean: `python -m tests.campaigns.dc_departures`.

`[SEEDS] [--rows TEXT] [--connection independent|star]`. The bench of `departures` with a torque
sensor without a high-pass. Prints of each row in how many trials the intervals of gains, offsets
and cogging torque hold the truth, Type A and expanded, and the findings and refusals; exits with 1
if the expanded ones do not, a cause is not named, or a sound bench has a finding.
"""

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from math import radians
from typing import Any

import numpy as np

from motord.config import Config
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.identification import IdentifyError
from motord.virtual import processors
from motord.virtual.bench import EPOCH_NS
from tests.campaigns import departed, seeds
from tests.campaigns.departures import (
    MESH,
    Changes,
    Departure,
    captured,
    errors_over_expanded,
    errors_over_half_widths,
)

SEEDS = 10
NAME = "torque-of-currents"
MEAN_TORQUE = "the mean torque that "
"""What a refusal says that names the cause."""
SENSOR = {"highpass_time_constant_s": 0.0}
SOUND = "none"


@dataclass(frozen=True)
class Row:
    """A departure; named: finding that all trials have to have; refused: a refusal may say so."""

    departure: Departure
    named: str = ""
    refused: bool = False


def _sensor(changes: Mapping[str, Any], _: float) -> Changes:
    return {"torque_sensor": {**SENSOR, **changes}}


def _turned(electrical_deg: float, _: float) -> Changes:
    zero = {"offset_rad": radians(electrical_deg / 8)}
    return {"torque_sensor": SENSOR, "encoder": zero}


def _recorded_turned(electrical_deg: float, _: float, ticks: np.ndarray) -> np.ndarray:
    turned = ticks.copy()
    turned["encoder_count"] += round(4096 / 8 * electrical_deg / 360)
    turned["encoder_count"] %= 4096
    return turned


def _passing_mean(_: float, config: Config) -> Config:
    sensor = config.torque_sensor.model_copy(update=SENSOR)
    return config.model_copy(update={"torque_sensor": sensor})


def _friction(coulomb_Nm: float, _: float) -> Changes:
    friction = {"coulomb_Nm": coulomb_Nm, "static_Nm": 1.2 * coulomb_Nm}
    return {"torque_sensor": {**SENSOR, "sees_friction": True}, "rotor": friction}


def _zero(zero_Nm: float, Nm_per_s: float, _: float, ticks: np.ndarray) -> np.ndarray:
    moved = ticks.copy()
    moved["torque_Nm"] += zero_Nm + Nm_per_s * (ticks["t_ns"] - EPOCH_NS) * 1e-9
    return moved


PASSES = partial(_sensor, {})


def _row(
    name: str,
    tables: Callable[[float], Changes] = PASSES,
    recorded: Callable[[float, np.ndarray], np.ndarray] = lambda _, ticks: ticks,
    named: str = "",
) -> Row:
    departure = Departure(name, (named,), tables, _passing_mean, recorded)
    return Row(departure, named, refused=named == NAME)


ROWS = (
    _row(SOUND),
    _row("encoder's zero 5 deg el", partial(_turned, 5.0), named="encoder-zero"),
    _row("encoder's zero 20 deg el", partial(_turned, 20.0), named=NAME),
    *(
        _row(
            f"recorded angle {deg} deg el off", recorded=partial(_recorded_turned, deg), named=NAME
        )
        for deg in (20, 90, 180)
    ),
    _row("torque sensor's gain 0.5 %", partial(_sensor, {"delta": 1.005})),
    _row("torque sensor's zero 0.3 Nm", recorded=partial(_zero, 0.3, 0.0)),
    _row("torque sensor's zero drifts by 1 mNm/s", recorded=partial(_zero, 0.0, 1e-3)),
    _row("friction of 0.03 Nm that the sensor sees", partial(_friction, 0.03)),
    _row("friction of 0.2 Nm that the sensor sees", partial(_friction, 0.2)),
)


def trial(place: int, connection: str, seed: int) -> departed.Trial | str:
    """Return what a trial shows, or its refusal."""
    row = ROWS[place]
    config, truth, points = captured(connection, row.departure, seed, mesh=MESH)
    calibrator = Calibrator(config.motor, config.torque_sensor, lambda: points, config.accuracy)
    try:
        for point in points:
            calibrator.add(point)
        result = calibrator.result("joint")
    except IdentifyError as error:
        return str(error)
    type_a = errors_over_half_widths(result, truth)
    expanded = errors_over_expanded(result, truth)
    held = {f"expanded {_figure(n)}": bool(one <= 1) for n, one in enumerate(expanded)}
    held |= {f"A {_figure(n)}": bool(one <= 1) for n, one in enumerate(type_a)}
    return departed.Trial(held, result.findings)


def _figure(number: int) -> str:
    if number < 6:
        return ("alpha_", "beta_")[number // 3] + "abc"[number % 3]
    return f"cogging {number - 5}"


def show(row: Row, connection: str, found: list[departed.Trial | str]) -> bool:
    """Print a row; return whether it keeps its bounds."""
    taken = [None if isinstance(one, str) else one for one in found]
    first = next((one for one in taken if one is not None), None)
    figures = first.held if first else ()
    lost = [key for key in figures if key.startswith("A ") or row.named == NAME]
    refusals = [one for one in found if isinstance(one, str)]
    kept = True
    if len(refusals) < len(found) or not row.refused:
        what = f"{connection}, {row.departure.name}"
        kept = departed.judge(what, taken, named=row.named, lost=lost, refused=row.refused)
    kept &= all(MEAN_TORQUE in text for text in refusals)
    for text in refusals[:1]:
        print(f"{connection}, {row.departure.name}: {len(refusals)} refused: {text}", flush=True)
    sound = row.departure.name == SOUND
    return kept and not (sound and any(one and tuple(one.findings) for one in taken))


def main(arguments: list[str]) -> int:
    """Run the rows that are asked for and print them; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="?", type=int, default=SEEDS, help="trials of each row")
    parser.add_argument("--rows", default="", help="rows with this in their names")
    parser.add_argument("--connection", choices=("independent", "star"))
    asked = parser.parse_args(arguments)
    connections = (asked.connection,) if asked.connection else ("independent", "star")
    kept = True
    with processors() as pool:
        for connection in connections:
            for place, row in enumerate(ROWS):
                if asked.rows in row.departure.name:
                    run = partial(trial, place, connection)
                    kept &= show(row, connection, list(pool.map(run, seeds.several(asked.seeds))))
    return int(not kept)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
