"""Findings where the bench departs from the model: `python -m tests.campaigns.departures [SEEDS]`.

Each row is a departure of the simulated rig, or of what the bench file says of it, at its size and
at a third of it, with phases independent and in a star. Prints a row as soon as it is known: in how
many trials a finding names its cause or family, in how many the truth lies in the stated interval,
and the largest error over the stated half-width; for a bench without departure, in how many trials
there is a finding all the same. Exits with 1 if a bound is not kept. `--rows`, `--connection` and
`--size` run it in parts.
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import radians
from typing import Any, NamedTuple

import numpy as np

from motord.config import AccuracyConfig, BackEmfHarmonic, Config, load
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.identification.operating_points import PointData, split
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.uncertainty_budget import totals
from motord.virtual import VirtualBench, processors, run_plan
from tests.campaigns import seeds

SEEDS = 10
CLEAN = 4
"""Trials without a departure for each one with."""

MESH = {"torques_Nm": [1.0, 3.0, 5.0], "speeds_Hz": [0.5, 0.7, 0.9], "turns": 8, "settle_s": 0.3}
ONE_WAY = {"directions": "forwards"}
RATED_A = 20.0
SIZES = (1.0, 1 / 3)

FOUND = 0.95
FALSE = 0.02
HELD = 0.95
SLACK = 2.5
"""Standard deviations of a share over few trials by which it may lie beyond its bound."""

LEFT = ("torque-left", "torque-left-linear", "torque-left-growing")
Changes = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Departure:
    """What departs at a size of 1, and the findings that name it or its family.

    found_as is empty where nothing shows it, and the expanded uncertainty has to hold it.
    tables: changes of the rig's tables at a size; config: of what the bench file says; recorded: of
    the ticks (n,) of an operating point that the rig gave; said: text of a note that says
    beforehand that it cannot be seen; mesh: settings of the plan.
    """

    name: str
    found_as: tuple[str, ...]
    tables: Callable[[float], Changes] = lambda _: {}
    config: Callable[[float, Config], Config] = lambda _, config: config
    recorded: Callable[[float, np.ndarray], np.ndarray] = lambda _, ticks: ticks
    said: str = ""
    mesh: Mapping[str, Any] | None = None


def _encoder(order: int, amplitude_deg: float, size: float) -> Changes:
    error = {"order": order, "amplitude_rad": size * radians(amplitude_deg), "phase_rad": 0.4}
    return {"encoder": {"errors": [error]}}


def _friction(size: float) -> Changes:
    ripple = {"order": 48, "amplitude_Nm": 0.003 * 6.0 * size, "phase_rad": 0.7}
    return {"rotor": {"friction_ripple": [ripple]}}


def _back_emf_without(order: int, size: float, config: Config) -> Config:
    """Return a bench file in which the harmonic of an order is too small by `size` of itself."""
    assert isinstance(config.motor.back_emf, tuple)
    harmonics = tuple(
        BackEmfHarmonic(
            order=one.order,
            amplitude_V_s_per_rad=one.amplitude_V_s_per_rad
            * (1 - size if one.order == order else 1),
            phase_rad=one.phase_rad,
        )
        for one in config.motor.back_emf
    )
    motor = config.motor.model_copy(update={"back_emf": harmonics})
    return config.model_copy(update={"motor": motor})


def torque_late(late_s: float, size: float, ticks: np.ndarray) -> np.ndarray:
    """Return ticks with the torque of `size * late_s` before."""
    t_s = (ticks["t_ns"] - ticks["t_ns"][0]) * 1e-9
    later = ticks.copy()
    later["torque_Nm"] = np.interp(t_s - size * late_s, t_s, ticks["torque_Nm"].astype(float))
    return later


def _backlash(counts: int, size: float, ticks: np.ndarray) -> np.ndarray:
    """Return ticks of an encoder of 4096 counts that is behind by so many of them backwards."""
    moved, steps = ticks.copy(), np.diff(ticks["encoder_count"])
    if (steps < 0).sum() > (steps > 0).sum():
        moved["encoder_count"] = (ticks["encoder_count"] + round(size * counts)) % 4096
    return moved


DEPARTURES = (
    Departure(
        "torque sensor's cross-talk 1 % at 2p",
        ("torque-sensor-crosstalk", *LEFT),
        lambda x: {"torque_sensor": {"crosstalk": [
            {"order": 16, "share": 0.01 * x, "phase_rad": 0.3}]}},
    ),
    Departure(
        "friction ripple 0.3 % at order 48, one direction",
        (), _friction, mesh=ONE_WAY, said="friction",
    ),
    Departure(
        "friction ripple 0.3 % at order 48, both directions",
        ("friction-ripple",), _friction,
    ),
    Departure(
        "encoder's zero 5 deg el",
        ("encoder-zero", "current-age"),
        lambda x: {"encoder": {"offset_rad": x * radians(5 / 8)}},
    ),
    Departure("encoder 0.1 deg once", ("encoder-error-order-1",), partial(_encoder, 1, 0.1)),
    Departure("encoder 0.3 deg once", ("encoder-error-order-1",), partial(_encoder, 1, 0.3)),
    Departure("encoder 0.5 deg once", ("encoder-error-order-1",), partial(_encoder, 1, 0.5)),
    Departure("encoder 0.3 deg twice", ("encoder-error-order-2",), partial(_encoder, 2, 0.3)),
    Departure(
        "current sensors' cross-talk 1 %",
        ("current-sensor-crosstalk", "kirchhoff", *LEFT),
        lambda x: {"inverter": {"crosstalk": [
            [0, 0.01 * x, -0.01 * x], [0.01 * x, 0, 0.01 * x], [-0.01 * x, 0.01 * x, 0]]}},
    ),
    Departure(
        "back-EMF 5 % less at rated current",
        ("back-emf-load", *LEFT),
        lambda x: {"motor": {"back_emf_drop_per_A": 0.05 * x / RATED_A}},
    ),
    Departure(
        "current sensors' gain 1 % over range",
        ("current-sensor-nonlinearity", "kirchhoff", *LEFT),
        lambda x: {"inverter": {"nonlinearity": {
            "linear_per_A": [5e-4 * x, -5e-4 * x, 5e-4 * x],
            "quadratic_per_A2": [2e-5 * x, 2e-5 * x, -2e-5 * x]}}},
    ),
    Departure(
        "cogging 5 % more with current",
        ("cogging-load", *LEFT),
        lambda x: {"motor": {"cogging_rise_per_A": 0.05 * x / RATED_A}},
    ),
    Departure(
        "high-pass stated 50 % too long",
        ("highpass-time-constant",),
        lambda x: {"torque_sensor": {"highpass_time_constant_s": 2.0 / (1 + 0.5 * x)}},
    ),
    Departure(
        "back-EMF's order 5 (2 %) missing",
        ("back-emf",), config=partial(_back_emf_without, 5),
    ),
    Departure(
        "back-EMF's order 7 (1 %) missing",
        ("back-emf",), config=partial(_back_emf_without, 7),
    ),
    Departure(
        "torque 1 ms older than the angle", ("torque-age",), recorded=partial(torque_late, 1e-3),
    ),
    Departure(
        "encoder's backlash 0.26 deg", ("backlash",), recorded=partial(_backlash, 3),
    ),
    Departure(
        "magnets that lose 0.2 % per kelvin", (),
        lambda x: {"thermal": {"back_emf_per_K": -0.002 * x}},
    ),
)  # fmt: skip


class Job(NamedTuple):
    """A trial: of a row's departure, or of none (row -1); full: with the mesh of the bench file."""

    row: int
    connection: str
    size: float
    seed: int
    full: bool = False


class Trial(NamedTuple):
    """Names of the findings; errors over half-widths and over expanded uncertainties.

    alike: a finding says that the cause would look nearly the same; said: a note speaks of it.
    """

    names: tuple[str, ...]
    alike: bool
    said: bool
    ratios: np.ndarray
    expanded_ratios: np.ndarray


def rig(connection: str, changes: Changes) -> tuple[Config, RigTruth]:
    """Return the packaged bench with a rig that departs from it; its gains stay what they are."""
    config, truth = load(), load_truth()
    tables = truth.model_dump(exclude_none=True)
    tables["inverter"]["gain_drift_per_K"] = (0.0, 0.0, 0.0)
    for name, table in changes.items():
        tables[name] |= table
    tables["motor"]["connection"] = connection
    motor = config.motor.model_copy(update={"connection": connection})
    return config.model_copy(update={"motor": motor}), RigTruth.model_validate(tables)


def captured(
    connection: str,
    departure: Departure | None,
    seed: int,
    *,
    size: float = 1.0,
    mesh: Mapping[str, Any] = MESH,
) -> tuple[Config, RigTruth, list[PointData]]:
    """Return the bench, what is true of its rig, and the operating points of a calibration."""
    config, truth = rig(connection, departure.tables(size) if departure else {})
    if departure is not None:
        config = departure.config(size, config)
        mesh = {**mesh, **(departure.mesh or {})}
    bench = VirtualBench(config, truth, seed)
    blocks: list[np.ndarray] = []
    plan = build("calibrate", config, dict(mesh))
    taken = run_plan(bench, plan, lambda ticks, _: blocks.append(ticks))
    points = split(np.concatenate(blocks), taken)
    if departure is not None:
        points = (replace(point, ticks=departure.recorded(size, point.ticks)) for point in points)
    return config, truth, list(points)


def calibration_of(
    config: Config, points: Sequence[PointData], accuracy: AccuracyConfig | None = None
) -> CalibrationResult:
    """Return what a calibration finds from operating points."""
    calibrator = Calibrator(config.motor, config.torque_sensor, lambda: points, accuracy)
    for point in points:
        calibrator.add(point)
    return calibrator.joint()


def calibrated(
    connection: str,
    departure: Departure | None,
    seed: int,
    *,
    size: float = 1.0,
    mesh: Mapping[str, Any] = MESH,
) -> tuple[CalibrationResult, RigTruth]:
    """Return what a calibration finds on the rig, and what is true of that."""
    config, truth, points = captured(connection, departure, seed, size=size, mesh=mesh)
    return calibration_of(config, points), truth


def errors_over_half_widths(result: CalibrationResult, truth: RigTruth) -> np.ndarray:
    """Return |error| over the stated 95 % half-width of alpha, beta and cogging amplitudes."""
    errors, orders = _errors(result, truth)
    assert result.alpha_half_width is not None
    assert result.beta_half_width_A is not None
    half_widths = [*result.alpha_half_width, *result.beta_half_width_A]
    half_widths += [one.half_width_Nm for one in result.harmonics if one.order in orders]
    return np.abs(errors) / np.array(half_widths)


def errors_over_expanded(result: CalibrationResult, truth: RigTruth) -> np.ndarray:
    """Return the same over the expanded uncertainty, Type A and Type B."""
    errors, orders = _errors(result, truth)
    both = totals(result.budget)[2]
    combined = [*both.alpha, *both.beta_A, *[both.cogging_Nm] * len(orders)]
    alpha, beta, _, cogging = both.coverage_factors
    factors = np.repeat([alpha, beta, cogging], [3, 3, len(orders)])
    return np.abs(errors) / (factors * np.array(combined))


def _errors(result: CalibrationResult, truth: RigTruth) -> tuple[np.ndarray, list[int]]:
    """Return the errors of alpha, beta and cogging amplitudes, and the orders of these."""
    alpha = np.array(truth.inverter.alpha)
    cogging_Nm = {one.order: abs(one.amplitude_Nm) for one in truth.motor.cogging}
    lines = [one for one in result.harmonics if one.order in cogging_Nm]
    errors = [
        *(result.alpha - alpha / np.cbrt(alpha.prod())),
        *(result.beta_A - truth.inverter.beta_A),
        *(one.amplitude_Nm - cogging_Nm[one.order] for one in lines),
    ]
    return np.array(errors), [one.order for one in lines]


def trial(job: Job) -> Trial:
    """Run one trial."""
    departure = DEPARTURES[job.row] if job.row >= 0 else None
    mesh = {} if job.full else MESH
    result, truth = calibrated(job.connection, departure, job.seed, size=job.size, mesh=mesh)
    said = departure is not None and any(departure.said in one for one in result.observable)
    names = tuple(finding.name for finding in result.findings)
    meanings = " ".join(finding.meaning for finding in result.findings)
    alike = departure is not None and any(name in meanings for name in departure.found_as)
    return Trial(
        names,
        alike,
        said,
        errors_over_half_widths(result, truth),
        errors_over_expanded(result, truth),
    )


def show(job: Job, trials: list[Trial]) -> bool:
    """Print a row; return whether it keeps its bounds."""
    departure = DEPARTURES[job.row] if job.row >= 0 else None
    ratios = np.array([one.ratios for one in trials])
    expanded = np.array([one.expanded_ratios for one in trials])
    covered = float((ratios <= 1).mean())
    if departure is None:
        share, bound, named = _share(one.names for one in trials), FALSE, "false"
        kept = share <= bound + _slack(bound, len(trials))
    elif departure.said:
        share, named, kept = float(np.mean([one.said for one in trials])), "said", True
        kept = share == 1.0
    elif not departure.found_as:
        share, named = _share(one.names for one in trials), "with a finding"
        kept = float((expanded <= 1).mean()) >= HELD - _slack(HELD, len(trials))
    else:
        found_as = set(departure.found_as)
        found = [bool(found_as & set(one.names)) or one.alike for one in trials]
        share, bound, named = _share(found), FOUND, "found"
        kept = job.size < 1 or share >= bound - _slack(bound, len(trials))
    names = {name: sum(name in one.names for one in trials) for one in trials for name in one.names}
    what = "no departure" if departure is None else f"{departure.name} x {job.size:.2f}"
    print(
        f"{job.connection}, {what}: {100 * share:.0f} % {named}; covered {100 * covered:.0f} %, "
        f"worst error / half-width {ratios.max():.1f}; expanded covers "
        f"{100 * float((expanded <= 1).mean()):.0f} %, worst {expanded.max():.1f}; {names}",
        *("BAD",) * (not kept),
        *(f"\n  {line}" for line in _by_kind(ratios)),
        flush=True,
    )  # fmt: skip
    return kept


def _by_kind(ratios: np.ndarray) -> Iterator[str]:
    """Yield what each kind of figure has of ratios (trials, figures).

    The three gains of a trial, whose product is fixed, hold or do not hold together.
    """
    for kind, here in (("alpha", slice(3)), ("beta", slice(3, 6)), ("cogging", slice(6, None))):
        inside = (ratios[:, here] <= 1).mean(axis=1)
        error = inside.std(ddof=1) / np.sqrt(len(inside)) if len(inside) > 1 else np.nan
        yield (
            f"{kind}: covered {100 * inside.mean():.1f} +- {100 * error:.1f} % (standard "
            f"error over trials), worst error / half-width {ratios[:, here].max():.1f}"
        )


def _share(ones: Iterable[object]) -> float:
    return float(np.mean([bool(one) for one in ones]))


def _slack(share: float, trials: int) -> float:
    return float(SLACK * np.sqrt(share * (1 - share) / trials))


def main(arguments: list[str]) -> int:
    """Run the rows that are asked for and print them; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="?", type=int, default=SEEDS, help="trials of each row")
    parser.add_argument("--rows", default="", help="rows with this in their names; none: clean")
    parser.add_argument("--connection", choices=("independent", "star"))
    parser.add_argument("--size", choices=("1", "third"))
    parser.add_argument("--clean", type=int, help="trials without a departure")
    parser.add_argument("--full", action="store_true", help="the mesh of the bench file")
    parser.add_argument("--one-process", action="store_true", help="leave the others alone")
    asked = parser.parse_args(arguments)
    connections = (asked.connection,) if asked.connection else ("independent", "star")
    sizes = {"1": SIZES[:1], "third": SIZES[1:]}.get(asked.size, SIZES)
    clean = CLEAN * asked.seeds if asked.clean is None else asked.clean
    rows = [(-1, 1.0, clean)] if asked.rows in ("", "none") and clean else []
    rows += [
        (row, size, asked.seeds)
        for row, departure in enumerate(DEPARTURES)
        for size in sizes
        if asked.rows in departure.name
    ]
    first = seeds.first()
    kept = True
    with processors() as pool:
        run = map if asked.one_process else pool.map
        for connection in connections:
            for row, size, count in rows:
                jobs = [Job(row, connection, size, first + n, asked.full) for n in range(count)]
                kept &= show(jobs[0], list(run(trial, jobs)))
    return int(not kept)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
