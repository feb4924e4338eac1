"""A calibration while it is taken: after each operating point, how well everything is known."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from motord.config import Config
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.half_widths import of_result
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData, split
from motord.sequencing.precision import Precision


class LiveCalibration:
    """Takes ticks as they come, and each operating point when its capture has ended.

    Keeps the points, which the analysis may want to read again.
    """

    def __init__(self, config: Config, targets: Mapping[str, float]) -> None:
        self._targets = targets
        self._points: list[PointData] = []
        self._calibrator = Calibrator(
            config.motor, config.torque_sensor, lambda: iter(self._points), config.accuracy
        )
        self._blocks: list[np.ndarray] = []
        self._captures = 0

    def take(self, ticks: np.ndarray) -> None:
        """Take a block of ticks, structured as TICK_DTYPE; those of no operating point go."""
        inside = ticks["plan_point"] >= 0
        if inside.any():
            self._blocks.append(ticks[inside])

    def captured(self, point: Mapping[str, Any]) -> Precision:
        """Return what the captures give, with the one that `/operating_point` describes."""
        blocks, self._blocks = self._blocks, []
        self._captures += 1
        try:
            for data in split(np.concatenate(blocks), [point]) if blocks else ():
                self._points.append(data)
                self._calibrator.add(data)
            found = Precision(self._captures, self._calibrator.half_widths())
            return self._confirmed() if found.reaches(self._targets) else found
        except IdentifyError as error:
            return Precision(self._captures, obstacle=str(error))

    def _confirmed(self) -> Precision:
        """Return what the whole analysis says: intervals with what departs from the model."""
        result = self._calibrator.joint()
        serious = [one.name for one in result.findings if one.severity == "serious"]
        obstacle = f"findings: {', '.join(serious)}" if serious else ""
        return Precision(self._captures, of_result(result), obstacle)
