"""A tracker that knows as much as it has counted: alpha_a is 1 and a millionth for each tick."""

import sys
from dataclasses import replace

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
        quantity = TrackedQuantity("alpha_a", "the gain of phase a", "", *figures)
        unknown = replace(quantity, name="beta_a", meaning="the offset", half_width=float("inf"))
        return TrackedCalibration(
            self.calibration.id, self.t_ns, self.ticks, self.memory_s, (quantity, unknown)
        )

    def adopted(self):
        if self.ticks < 10:
            raise CalibrationError(f"{self.ticks} turns are too few")
        alpha = (1 + 1e-6 * self.ticks, *self.calibration.alpha[1:])
        content = {**dict(self.calibration), "id": "", "alpha": alpha}
        return type(self.calibration)(**content)
