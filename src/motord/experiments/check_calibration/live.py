"""A check of the calibration while it is taken: what speaks against a plan that is to follow."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from motord.calibration import CalibrationError, load
from motord.config import Config
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.check_calibration.estimate import check
from motord.experiments.check_calibration.result import NEEDED_PERCENT
from motord.experiments.subject import Subject
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData, split
from motord.schema import joined
from motord.sequencing.capture import final
from motord.sequencing.observation import Precision


class LiveCheck:
    """Takes ticks as they come, and each operating point when its capture has ended.

    With the last of so many `points` it gives the verdict: an obstacle if the calibration, a file,
    has drifted or these points cannot be evaluated. Raises CalibrationError.
    """

    def __init__(
        self, config: Config, targets: Mapping[str, float], calibration: str, points: int
    ) -> None:
        self._subject = Subject.of_config(config)
        self._calibration = load(Path(calibration))
        self._wanted = points
        self._blocks: list[np.ndarray] = []
        self._points: list[PointData] = []
        self._captures = 0

    def take(self, ticks: np.ndarray) -> None:
        """Take a block of ticks, structured as TICK_DTYPE."""
        self._blocks.append(ticks)

    def captured(self, point: Mapping[str, Any]) -> Precision:
        """Return how many points there are, with the one that `/operating_point` describes."""
        blocks, self._blocks = self._blocks, []
        if not final(point):
            return Precision(self._captures)
        self._captures += 1
        self._points += split(joined(blocks), [point]) if blocks else ()
        return self._verdict() if self._captures == self._wanted else Precision(self._captures)

    def _verdict(self) -> Precision:
        left_out = CapturesLeftOut()
        known = self._subject, self._calibration, NEEDED_PERCENT
        try:
            found = check(self._points, *known, left_out)
        except (CalibrationError, IdentifyError) as error:
            return Precision(self._captures, obstacle=f"not evaluated: {error}")
        drift = found.sentence if found.verdict == "drifted" else ""
        return Precision(
            self._captures, obstacle=drift, remark=f"{found.sentence}{left_out.as_text}"
        )
