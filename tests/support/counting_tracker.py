"""A tracker that knows as much as it has counted: alpha_a is 1 and a millionth for each tick."""

import sys

from motord.calibration import CalibrationError
from motord.experiments.tracking.tracked import TrackedCalibration, TrackedQuantity

LIMIT = 1.00005
"""An alpha_a above it has departed."""


class CountingTracker:
    """Begins at the first tick; a tick whose `missed` is 99 is an error in the program."""

    def __init__(self, config, calibration, memory_s):
        self.calibration, self.memory_s = calibration, memory_s
        self.ticks, self.t_ns = 0, 0

    def take(self, ticks):
        sys.stdout.write("a tracker may print\n")
        if (ticks["missed"] == 99).any():
            raise ValueError("no such tick")
        self.ticks += len(ticks)
        self.t_ns = int(ticks["t_ns"][-1])

    def tracked(self):
        if not self.ticks:
            return None
        alpha = 1 + 1e-6 * self.ticks
        figures = alpha, 1e-5, 1.0, 4e-5, alpha > LIMIT
        names = "value", "half_width", "in_force", "in_force_half_width", "departed"
        known = dict(zip(names, figures, strict=True))
        quantity = TrackedQuantity(name="alpha_a", meaning="the gain of phase a", unit="", **known)
        changed = {"name": "beta_a", "meaning": "the offset", "half_width": float("inf")}
        unknown = quantity.model_copy(update=changed)
        return TrackedCalibration(
            calibration=self.calibration.id,
            t_ns=self.t_ns,
            turns=self.ticks,
            memory_s=self.memory_s,
            quantities=(quantity, unknown),
        )

    def adopted(self):
        if self.ticks < 10:
            raise CalibrationError(f"{self.ticks} turns are too few")
        alpha = (1 + 1e-6 * self.ticks, *self.calibration.alpha[1:])
        content = {**dict(self.calibration), "id": "", "alpha": alpha}
        return type(self.calibration)(**content)
