"""`[accuracy]`: what data sheets and installation say of errors that data do not show (Type B)."""

from collections.abc import Sequence
from math import sqrt
from typing import Annotated

from pydantic import Field

from motord.config.base import Section
from motord.section.quantities import PowerFromZero, TorqueFromZero

Percent = Annotated[float, Field(ge=0, le=100)]
Angle = Annotated[float, Field(ge=0, le=1)]
AGE_MAX_S = 0.01
"""Half a period of the main cogging order, 48, at 1 turn a second."""


class AccuracyConfig(Section):
    """`[accuracy]`: limits of errors, half-widths of rectangular distributions; from data sheets.

    What is left out is assumed as typical of its class, and results say so.
    """

    encoder_zero_rad: Angle = 1e-3
    """Zero of the encoder, mechanical; `motord analyse align --write` states it."""
    encoder_error_rad: Angle = 5e-4
    """Error of the encoder once and twice a turn, mechanical: eccentric or tilted disc."""
    back_emf_percent: Percent = 0.5
    """Amplitude of the back-EMF's fundamental."""
    back_emf_harmonics_percent: Percent = 0.2
    """Each harmonic of the back-EMF, of its fundamental."""
    back_emf_temperature_percent: Percent = 20.0
    """Temperature coefficient of the back-EMF, of itself; counts where that is corrected."""
    magnet_temperature_K: Annotated[float, Field(ge=0, le=100)] = 3.0
    """Temperature of the magnets, as a channel has it; counts where the back-EMF is corrected."""
    saturation_percent: Percent = 1.0
    """Torque, and cogging torque, at the rated current: change with the current."""
    current_gain_percent: Percent = 1.0
    """Gain that all current sensors have in common; counts where delta epsilon is not measured."""
    torque_gain_percent: Percent = 0.5
    """Gain of the torque sensor and its amplifier."""
    torque_zero_Nm: TorqueFromZero = 0.01
    """Zero of the torque sensor and its amplifier, where it shows the mean."""
    power_gain_percent: Percent = 0.2
    """Gain of the reading of the DC power."""
    power_zero_W: PowerFromZero = 0.05
    """Zero of the reading of the DC power."""
    torque_time_constant_percent: Percent = 5.0
    """Time constant of the torque sensor's high-pass."""
    torque_age_s: Annotated[float, Field(ge=0, le=AGE_MAX_S)] = 2e-5
    """Delay of the torque sensor's amplifier and its sampling after the encoder's."""
    torque_crosstalk_percent: Percent = 0.5
    """Change of the torque sensor's gain with the angle: cross-talk of side forces."""
    current_crosstalk_percent: Percent = 0.1
    """Part of another phase's current in a current sensor."""
    current_linearity_percent: Percent = 0.2
    """Change of a current sensor's gain up to the rated current."""
    friction_ripple_percent: Percent = 0.3
    """Friction that changes with the angle, of the rated torque."""
    offset_like_cogging_percent: Percent = 0.05
    """Cogging torque at the pole pairs and three times them, of the rated torque."""

    @property
    def torque_scale(self) -> float:
        """Standard uncertainty of the torque sensor's gain, in parts (Type B)."""
        return self.torque_gain_percent / 100 / sqrt(3)


def widest(stated: Sequence[AccuracyConfig]) -> AccuracyConfig:
    """Return the largest of each limit; it counts as stated where that one was."""
    found = {}
    for name in AccuracyConfig.model_fields:
        largest = max(stated, key=lambda one: getattr(one, name))
        if name in largest.model_fields_set:
            found[name] = getattr(largest, name)
    return AccuracyConfig(**found)
