"""A calibration while it is taken: after each operating point, how well everything is known."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.lib.recfunctions import repack_fields

from motord.config import Config
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.half_widths import of_result
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData, split
from motord.recording.captures import COLUMNS
from motord.sequencing.precision import Precision


class LiveCalibration:
    """Takes ticks as they come, and each operating point when its capture has ended.

    Keeps the columns that are read of the points, which the analysis may want to read again. The
    ripple is that at the largest torque: no set-point of the mesh has more.
    """

    def __init__(self, config: Config, targets: Mapping[str, float]) -> None:
        self._targets = targets
        self._largest_Nm = 0.0
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
                self._calibrator.add(data)
                used = [name for name in COLUMNS if name in (data.ticks.dtype.names or ())]
                self._points.append(replace(data, ticks=repack_fields(data.ticks[used])))
                self._largest_Nm = max(self._largest_Nm, abs(data.torque_Nm))
            found = self._calibrator.half_widths((self._largest_Nm,))
            reached = Precision(self._captures, found).reaches(self._targets)
            return self._confirmed(found) if reached else Precision(self._captures, found)
        except IdentifyError as error:
            return Precision(self._captures, obstacle=str(error))

    def _confirmed(self, found: Mapping[str, float]) -> Precision:
        """Return the wider of what was found and what the whole analysis says of departures."""
        result = self._calibrator.joint()
        widths = {name: max(half, found[name]) for name, half in of_result(result).items()}
        serious = [one.name for one in result.findings if one.severity == "serious"]
        obstacle = f"findings: {', '.join(serious)}" if serious else ""
        return Precision(self._captures, widths, obstacle)
