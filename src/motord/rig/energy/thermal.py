"""The motor's temperatures: a lumped thermal network of three nodes, heated by the copper loss.

    C_w dT_w/dt = i^2 R (1 + a (T_w - T_0)) - (T_w - T_h) / R_wh - (T_w - T_m) / R_wm
    C_m dT_m/dt = (T_w - T_m) / R_wm - (T_m - T_h) / R_mh
    C_h dT_h/dt = (T_w - T_h) / R_wh + (T_m - T_h) / R_mh - (T_h - T_0) / R_h0

w winding, m magnets, h housing, 0 the room. Pure: no clock, no noise; all begins at T_0.
"""

from dataclasses import dataclass

from motord.rig.truth import RigTruth

STEP_SHARE = 0.05
"""Of the fastest time constant: the longest step of the integration."""
WINDING_MAX_C = 1000.0
"""Where the model ends: copper that is fed on would melt."""

Temperatures = tuple[float, float, float]
"""Of winding, magnets and housing, degC."""


@dataclass
class ThermalNetwork:
    """The network of a rig. `temperatures_C` is the truth."""

    truth: RigTruth

    def __post_init__(self) -> None:
        ambient_C = self.truth.simulation.ambient_C
        self.temperatures_C: Temperatures = (ambient_C, ambient_C, ambient_C)
        self._step_s = STEP_SHARE * self.truth.thermal.fastest_s

    @property
    def named_C(self) -> dict[str, float]:
        """Return the temperatures by the names that a bench file has for them."""
        return dict(zip(("winding_C", "magnet_C", "housing_C"), self.temperatures_C, strict=True))

    def advance(self, squares_A2: float, duration_s: float) -> None:
        """Let `duration_s` pass with `squares_A2`, the sum of the squares of the phase currents."""
        steps = max(round(duration_s / self._step_s + 0.5), 1)
        step_s = duration_s / steps
        for _ in range(steps):  # the midpoint rule
            now = self.temperatures_C
            half = _moved(now, self._rates_K_per_s(now, squares_A2), 0.5 * step_s)
            self.temperatures_C = _moved(now, self._rates_K_per_s(half, squares_A2), step_s)

    def _rates_K_per_s(self, temperatures_C: Temperatures, squares_A2: float) -> Temperatures:
        winding_C, magnet_C, housing_C = temperatures_C
        thermal, ambient_C = self.truth.thermal, self.truth.simulation.ambient_C
        rise = 1 + thermal.resistance_per_K * (winding_C - ambient_C)
        copper_W = squares_A2 * self.truth.motor.resistance_ohm * rise
        to_housing_W = (winding_C - housing_C) / thermal.winding_housing_K_per_W
        to_magnet_W = (winding_C - magnet_C) / thermal.winding_magnet_K_per_W
        through_W = (magnet_C - housing_C) / thermal.magnet_housing_K_per_W
        out_W = (housing_C - ambient_C) / thermal.housing_ambient_K_per_W
        return (
            (copper_W - to_housing_W - to_magnet_W) / thermal.winding_J_per_K,
            (to_magnet_W - through_W) / thermal.magnet_J_per_K,
            (to_housing_W + through_W - out_W) / thermal.housing_J_per_K,
        )


def _moved(temperatures_C: Temperatures, rates_K_per_s: Temperatures, by_s: float) -> Temperatures:
    winding_C, magnet_C, housing_C = (
        min(t + by_s * rate, WINDING_MAX_C)
        for t, rate in zip(temperatures_C, rates_K_per_s, strict=True)
    )
    return winding_C, magnet_C, housing_C
