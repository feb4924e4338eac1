"""Learning on the rig whose current sensors are not linear: RMS error of the true torque.

`python -m tests.campaigns.learn` prints the figures and exits 1 if a bound is not kept; `--report
FILE` writes the page.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from motord.config import Config, load, packaged
from motord.experiments.ilc.report import fill
from motord.experiments.plans import build
from motord.report.html import Page
from motord.reproduce.evaluate import Errors
from motord.reproduce.learning import learn_virtual
from motord.virtual.mesh import processors
from tests.campaigns import seeds
from tests.support.virtual_calibration import calibrate_virtual, verify_virtual

BEFORE_PERCENT = (0.8, 1.5)
AFTER_PERCENT = 0.2


def nonlinear(config: Config) -> Config:
    """Return the bench with the rig whose sensors are off by +-0.7 % of a range of 50 A."""
    bench = config.bench.model_copy(update={"rig": packaged("nonlinear.rig.toml")})
    return config.model_copy(update={"bench": bench})


def table(name: str, errors: Errors) -> str:
    """Return errors by torque and speed in lines."""
    speeds_Hz = sorted({speed_Hz for _, speed_Hz in errors})
    lines = [f"{name} (%)", "        " + "".join(f"{s:6g}/s" for s in speeds_Hz)]
    for torque_Nm in sorted({torque_Nm for torque_Nm, _ in errors}):
        row = "".join(f"{errors[torque_Nm, s]:8.3f}" for s in speeds_Hz)
        lines.append(f"{torque_Nm:5g} Nm{row}")
    values = list(errors.values())
    lines.append(f"from {min(values):.3f} to {max(values):.3f}, mean {np.mean(values):.3f}")
    return "\n".join(lines)


def main() -> int:
    """Calibrate, learn, verify on fresh noise; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=seeds.first())
    parser.add_argument("--report", type=Path)
    given = parser.parse_args()
    began_s, config = time.monotonic(), nonlinear(load())
    plan = build("verify", config)
    with processors() as pool:
        calibration = calibrate_virtual(config, given.seed, pool=pool)
        learned = learn_virtual(config, calibration, given.seed + 1, pool=pool)
        before = verify_virtual(config, calibration, given.seed + 2, plan, pool)
        after = verify_virtual(config, learned.calibration, given.seed + 2, plan, pool)
    print(table("calibration alone", before))
    print(table(f"learned in {len(learned.passes)} passes", after))
    for number, errors in enumerate(learned.truth, 1):
        values = list(errors.values())
        print(f"pass {number}: mean {np.mean(values):.3f} %, worst {max(values):.3f} %")
    print(f"{learned.bench_s:.0f} s of learning; all in {time.monotonic() - began_s:.0f} s")
    if given.report:
        page = Page("Learning of torque ripple", f"calibration {learned.calibration.id}")
        fill(page, learned.passes[-1], learned.truth)
        page.write(given.report)
    low, high = BEFORE_PERCENT
    kept = all(low <= error <= high for error in before.values())
    kept &= max(after.values()) <= AFTER_PERCENT
    print("kept" if kept else f"NOT kept: {low} to {high} % before, {AFTER_PERCENT} % after")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
