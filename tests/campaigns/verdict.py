"""Verdicts of motors whose truth is known: `python -m tests.campaigns.verdict [--rigs N]`.

MOTORS motors near a limit are drawn for each case: truth, measured value, stated uncertainty
(exact, or itself estimated with few degrees of freedom). Three statements are tested:

- specific risk (JCGM 106): where the truth is as likely anywhere near the limit, the share of wrong
  passes among the motors that pass, and among those that just pass, is at most the risk;
- of motors exactly at a limit, at most the risk passes, wherever the others are; beyond it, fewer;
- the other way round for fails.

What no rule by uncertainty can promise is shown, too: of a lot that is bad all over, every pass is
wrong. RIGS rigs are then calibrated in ten seconds, and each figure is compared with limits that
lie at its truth: by all of its uncertainty, which holds departures that these rigs do not have, and
by Type A alone, which is all that these show. Prints shares; exits with 1 if one is beyond the risk
by more than so few trials allow.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np

from motord.config.experiments import analysis_kinds
from motord.experiments.plans import build
from motord.identification.operating_points import split
from motord.rig.truth import RigTruth
from motord.verdict.decision import Decision, Figure, Tolerance, decide
from motord.verdict.figures import figures_of
from motord.virtual import VirtualBench, processors, run_plan
from tests.campaigns import seeds
from tests.campaigns.other_motors import MOTORS as RIG_MOTORS
from tests.campaigns.other_motors import rig_of
from tests.campaigns.quick import calibrated

MOTORS = 1000
RIGS = 24
RISK = 0.025
NEAR = 4.0
"""Standard uncertainties around a limit within which truths are drawn."""

JUST = 0.02
"""Probability of conformity above 1 - risk up to which a motor just passes."""

SLACK = 3.5
"""Standard deviations of a share by which it may be beyond the risk."""


@dataclass(frozen=True)
class Case:
    """Limits in standard uncertainties; freedom: of the stated uncertainty, None if it is exact."""

    name: str
    tolerance: Tolerance
    freedom: int | None = None


CASES = (
    Case("upper limit", Tolerance(None, 0.0)),
    Case("lower limit", Tolerance(0.0, None)),
    Case("limits 10 u apart", Tolerance(-5.0, 5.0)),
    Case("limits 4 u apart", Tolerance(-2.0, 2.0)),
    Case("limits 0.02 u apart", Tolerance(-0.01, 0.01)),
    Case("upper limit, 10 degrees of freedom", Tolerance(None, 0.0), 10),
    Case("upper limit, 3 degrees of freedom", Tolerance(None, 0.0), 3),
    Case("limits 10 u apart, 3 degrees of freedom", Tolerance(-5.0, 5.0), 3),
)


def conforms(truth: float, tolerance: Tolerance) -> bool:
    """Return whether a true value is within limits."""
    low, high = tolerance.low, tolerance.high
    return (low is None or truth >= low) and (high is None or truth <= high)


def measured(truth: float, freedom: int | None, rng: np.random.Generator) -> Figure:
    """Return a measurement of a truth with the standard uncertainty 1, stated as known."""
    stated = 1.0 if freedom is None else float(np.sqrt(rng.chisquare(freedom) / freedom))
    return Figure("drawn", "", truth + float(rng.normal()), stated, freedom)


@dataclass(frozen=True)
class Share:
    """Of so many motors, how many; most: what the share is at most, None if nothing is promised."""

    name: str
    count: int
    of: int
    most: float | None = None

    @property
    def kept(self) -> bool:
        """Whether the share is at most what is promised, but for chance."""
        if self.most is None or self.of == 0:
            return True
        slack = SLACK * np.sqrt(self.most * (1 - self.most) / self.of)
        return bool(self.count / self.of <= self.most + slack)

    def __str__(self) -> str:
        """Return a line."""
        percent = f"{100 * self.count / self.of:.2f} %" if self.of else "none"
        limit = "" if self.most is None else f", at most {100 * self.most:g} %"
        return f"  {self.name}: {percent} ({self.count} of {self.of}{limit})"


def drawn(case: Case, rng: np.random.Generator) -> Iterator[Share]:
    """Yield the shares of a case with truths that are as likely anywhere near its limits."""
    ends = [end for end in (case.tolerance.low, case.tolerance.high) if end is not None]
    truths = rng.uniform(min(ends) - NEAR, max(ends) + NEAR, MOTORS)
    found: list[tuple[bool, Decision, float]] = []
    for truth in truths.tolist():
        one = decide(measured(truth, case.freedom, rng), case.tolerance, RISK)
        assert one.probability is not None
        found.append((conforms(truth, case.tolerance), one.decision, one.probability))
    passed = [good for good, decision, _ in found if decision == "pass"]
    just = [good for good, _, p in found if 1 - RISK <= p < 1 - RISK + JUST]
    failed = [good for good, decision, _ in found if decision == "fail"]
    yield Share("wrong passes, of all passes", passed.count(False), len(passed), RISK)
    yield Share("wrong passes, of those that just pass", just.count(False), len(just), RISK)
    yield Share("wrong fails, of all fails", failed.count(True), len(failed), RISK)
    yield Share("undecidable", MOTORS - len(passed) - len(failed), MOTORS)


def at_the_limit(case: Case, rng: np.random.Generator) -> Iterator[Share]:
    """Yield what becomes of motors whose truth is a limit, and of those that are just beyond it."""
    limit = case.tolerance.high if case.tolerance.high is not None else case.tolerance.low
    assert limit is not None
    outwards = 1.0 if case.tolerance.high is not None else -1.0
    for beyond, name in ((0.0, "at the limit"), (0.5, "half an uncertainty beyond it")):
        decisions = [
            decide(measured(limit + outwards * beyond, case.freedom, rng), case.tolerance, RISK)
            for _ in range(MOTORS)
        ]
        passes = sum(one.decision == "pass" for one in decisions)
        yield Share(f"passes, {name}", passes, MOTORS, RISK)
        if not beyond:
            fails = sum(one.decision == "fail" for one in decisions)
            yield Share(f"fails, {name}", fails, MOTORS, RISK)


def bad_lot(rng: np.random.Generator) -> Share:
    """Return the share of wrong passes where every motor is half an uncertainty outside."""
    tolerance = Tolerance(None, 0.0)
    passed = sum(
        decide(measured(0.5, None, rng), tolerance, RISK).decision == "pass"
        for _ in range(10 * MOTORS)
    )
    return Share("wrong passes, of all passes, where all motors are bad", passed, passed)


Compared = list[tuple[Figure, float]]
"""Figures, and what is true of each."""


def rig_figures(motor: str, seed: int) -> tuple[Compared, Compared]:
    """Calibrate the rig of `seed` in ten seconds; return its figures, then with Type A alone."""
    config, truth, delta, epsilon = rig_of(motor, seed)
    bench = VirtualBench(config, truth, seed)
    blocks: list[np.ndarray] = []
    plan = build("calibrate", config, {"time_limit_s": 10.0})
    taken = run_plan(bench, plan, lambda ticks, _: blocks.append(ticks))
    result = calibrated(config, list(split(np.concatenate(blocks), taken)))
    content = result.to_calibration(config.motor, datetime.now(UTC), ["rig"]).to_json()
    true = truths_of(truth, delta, epsilon)
    of_data = {**content, "budget": [one for one in content["budget"] if one["type"] == "A"]}
    return compared(content, true), compared(of_data, true)


def truths_of(truth: RigTruth, delta: float, epsilon: float) -> dict[str, float]:
    """Return what is true of the figures of a calibration, by name."""
    alpha = np.array(truth.inverter.alpha)
    common = float(np.cbrt(alpha.prod()))
    beta_A = truth.inverter.beta_A
    return {
        **{f"alpha, phase {p}": a / common for p, a in zip("abc", alpha.tolist(), strict=True)},
        "alpha_spread": float(np.ptp(alpha)) / common,
        **{f"beta_A, phase {p}": delta * b for p, b in zip("abc", beta_A, strict=True)},
        **{f"cogging_Nm, order {w.order}": delta * w.amplitude_Nm for w in truth.motor.cogging},
        "delta_epsilon": delta * epsilon * common,
    }


def compared(content: dict[str, Any], true: dict[str, float]) -> Compared:
    """Return the figures of a calibration whose truth is known."""
    kinds = analysis_kinds()["calibrate"].figures
    figures = [one for kind in kinds for one in figures_of(kind, content, {})]
    return [(one, true[one.name]) for one in figures if one.name in true]


def rigs(pairs: Compared, name: str) -> Iterator[Share]:
    """Yield shares over figures whose limits lie at their truths, or farther off."""
    passes = [
        decide(figure, tolerance, RISK).decision == "pass"
        for figure, truth in pairs
        for tolerance in (Tolerance(None, truth), Tolerance(truth, None))
    ]
    yield Share(f"{name}: passes, at the limit", sum(passes), len(passes), RISK)
    for apart in (2.0, 3.0, 4.0, 6.0):
        decisions = [
            decide(one, Tolerance(truth - apart * u, truth + apart * u), RISK).decision
            for one, truth in pairs
            if (u := one.standard_uncertainty)
        ]
        undecidable, n = decisions.count("undecidable"), len(decisions)
        yield Share(f"limits {apart:g} u to each side: undecidable", undecidable, n)
        yield Share("its wrong fails", decisions.count("fail"), n, RISK)


def main() -> int:
    """Draw all cases, calibrate the rigs, print shares, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=RIGS)
    options = parser.parse_args()
    rng = np.random.default_rng(seeds.first())
    kept = True
    for case in CASES:
        print(case.name, flush=True)
        kept &= _print([*drawn(case, rng), *at_the_limit(case, rng)])
    kept &= _print([bad_lot(rng)])
    if options.rigs:
        with processors() as pool:
            made = pool.map(partial(rig_figures, RIG_MOTORS[0]), seeds.several(options.rigs))
            of_all, of_data = zip(*made, strict=True)
        for name, parts in (("rigs, all of u", of_all), ("rigs, Type A alone", of_data)):
            kept &= _print(list(rigs([pair for part in parts for pair in part], name)))
    return int(not kept)


def _print(shares: Sequence[Share]) -> bool:
    for share in shares:
        print(f"{share}{'' if share.kept else '  NOT KEPT'}", flush=True)
    return all(share.kept for share in shares)


if __name__ == "__main__":
    sys.exit(main())
