"""How near a calibration is to the Cramer-Rao bound of its sensors' noise, and what is between."""

from motord.calibration.parts import Part
from motord.config import NonNegative

WHITE_NOISE = "white noise"
"""Source of variance that no estimator avoids."""

PRIORS = "priors"
"""Source of variance that the bound has, too."""

NAMED_SHARE = 0.02
"""Share of the variance from which on what holds a calibration back is named."""


class BoundedQuantity(Part):
    """Standard error of a quantity at the Cramer-Rao bound, in `unit`.

    efficiency: square of the bound over that of the stated standard error; above 1 by chance alone.
    """

    quantity: str
    unit: str
    bound: NonNegative
    efficiency: NonNegative


class VarianceShare(Part):
    """Share of the variance of the predicted ripple that comes from a source."""

    source: str
    share: NonNegative


class CramerRao(Part):
    """Cramer-Rao bound of a calibration, its efficiency, and the ripple that its errors leave.

    white_noise_Nm: standard deviation of what is white in the measured torque, per sample, RMS over
    the operating points; encoder_noise_Nm, current_noise_Nm: the parts of it that the encoder's
    rounding and the noise of the currents make. ripple_percent: predicted, of rated torque, at the
    torques of the points; ripple_upper_percent: it is below with a probability of 95 %. quantities:
    the last is that ripple; shares: of its variance.
    """

    white_noise_Nm: NonNegative
    encoder_noise_Nm: NonNegative
    current_noise_Nm: NonNegative
    ripple_percent: NonNegative
    ripple_upper_percent: NonNegative
    quantities: tuple[BoundedQuantity, ...]
    shares: tuple[VarianceShare, ...]

    @property
    def held_back_by(self) -> str:
        """What takes most of the variance beyond the bound; "" if nothing takes much."""
        avoidable = [one for one in self.shares if one.source not in (WHITE_NOISE, PRIORS)]
        most = max(avoidable, key=lambda one: one.share, default=None)
        return most.source if most is not None and most.share > NAMED_SHARE else ""

    @property
    def efficiency(self) -> float:
        """Efficiency of the predicted ripple."""
        return self.quantities[-1].efficiency

    def to_text(self) -> list[str]:
        """Return what a calibration's text says of it, a line each."""
        named = self.held_back_by if self.efficiency < 1.0 else ""  # above 1 by chance: no rest
        most = f"; most of the rest: {named}" if named else ""
        return [
            f"predicted ripple, by the errors of Type A: {self.ripple_percent:.2g} % of rated "
            f"torque, below {self.ripple_upper_percent:.2g} % (95 %)",
            f"efficiency {self.efficiency:.2f} of the Cramer-Rao bound (ripple){most}",
        ]

    @property
    def noise_text(self) -> str:
        """What the bound is of."""
        white, encoder, currents = (
            f"{1e3 * each:.2g} mNm"
            for each in (self.white_noise_Nm, self.encoder_noise_Nm, self.current_noise_Nm)
        )
        return (
            f"the bound is that of the torque's white noise, {white} per sample; rounding of the "
            f"encoder makes {encoder} of it, noise of the currents {currents}"
        )
