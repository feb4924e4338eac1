"""A calibration of recordings, with what made it."""

from dataclasses import dataclass

from motord.calibration import Calibration
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.findings import Finding


@dataclass(frozen=True)
class CalibratedRuns:
    """A calibration, the result that it was made of, and one to compare with, if it was named."""

    calibrator: Calibrator
    result: CalibrationResult
    calibration: Calibration
    other: Calibration | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Where the data depart from the model."""
        return self.calibration.findings or ()

    def both(self) -> tuple[CalibrationResult, CalibrationResult]:
        """Return the result and that of the other estimator. Raises IdentifyError."""
        return self.result, self.calibrator.result(
            "residual" if self.result.method == "joint" else "joint"
        )
