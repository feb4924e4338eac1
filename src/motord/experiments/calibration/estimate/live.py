"""A calibration while it is taken: after each operating point, how well everything is known."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.lib.recfunctions import repack_fields

from motord.config import Config
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData, split
from motord.recording.captures import COLUMNS
from motord.schema import joined, rows_of
from motord.sequencing.observation import Precision

AGAIN = 1.25
"""Factor by which captures must have grown since a whole analysis that did not confirm the targets
until there is another one: the more there are, the longer it takes."""


class LiveCalibration:
    """Takes ticks as they come, and each operating point when its capture has ended.

    Targets count as reached once the whole analysis confirms them. Until it is repeated, what it
    said holds, where half-widths alone say more. Keeps the columns that are read of the points,
    which the analysis may want to read again. The ripple is that at the largest torque: no
    set-point of the mesh has more.
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
        self._unconfirmed = Precision(0)

    def take(self, ticks: np.ndarray) -> None:
        """Take a block of ticks, structured as TICK_DTYPE; those of no operating point go."""
        inside = ticks["plan_point"] >= 0
        if inside.any():
            self._blocks.append(rows_of(ticks, inside))

    def captured(self, point: Mapping[str, Any]) -> Precision:
        """Return what the captures give, with the one that `/operating_point` describes."""
        blocks, self._blocks = self._blocks, []
        self._captures += 1
        try:
            for data in split(joined(blocks), [point]) if blocks else ():
                self._calibrator.add(data)
                used = [name for name in COLUMNS if name in (data.ticks.dtype.names or ())]
                self._points.append(replace(data, ticks=repack_fields(data.ticks[used])))
                self._largest_Nm = max(self._largest_Nm, abs(data.torque_Nm))
            found = self._calibrator.half_widths((self._largest_Nm,))
            precision = Precision(self._captures, found)
            return self._confirmed(found) if precision.reaches(self._targets) else precision
        except IdentifyError as error:
            return Precision(self._captures, obstacle=str(error))

    def _confirmed(self, found: Mapping[str, float]) -> Precision:
        """Return the wider of what was found and what the whole analysis says of departures."""
        last = self._unconfirmed
        if self._captures < AGAIN * last.captures:
            return Precision(self._captures, _wider(found, last.half_widths), last.obstacle)
        result = self._calibrator.result("joint")
        serious = [one.name for one in result.findings if one.severity == "serious"]
        obstacle = f"findings: {', '.join(serious)}" if serious else ""
        precision = Precision(self._captures, _wider(found, result.target_half_widths), obstacle)
        if not precision.reaches(self._targets):
            self._unconfirmed = precision
        return precision


def _wider(found: Mapping[str, float], others: Mapping[str, float]) -> dict[str, float]:
    """Return each half-width found, or the other one if that is wider."""
    return {name: max(half, others.get(name, 0.0)) for name, half in found.items()}
