"""The temperatures while a plan heats or cools: when that ends, and why it must not go on."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from motord.experiments.thermal import ThermalConfig
from motord.experiments.thermal.steadiness import ChannelWindow
from motord.sequencing.motions import MotionFailed
from motord.sequencing.observation import ChannelValue

LABEL_EVERY_S = 5.0
"""Time between two texts that an operator reads."""

PATIENCE_S = 60.0
"""Time for which a channel may have no valid value while the motor cools."""

STEADY, TIME_LIMIT, TEMPERATURE_LIMIT = "steady", "time limit", "temperature limit"


class TemperatureWatch:
    """The channels of a plan's settings, since the beginning of a heat-up or a cooling.

    `label`: what an operator reads.
    """

    def __init__(self, own: ThermalConfig, limit_s: float) -> None:
        self._own = own
        self._limit_s = limit_s
        self._windows = {
            name: ChannelWindow(own.steady_window_s)
            for name in (*own.nodes.values(), own.ambient_channel)
            if name
        }
        self._seen_s = 0.0
        self._labelled_s = -LABEL_EVERY_S
        self._invalid_since_s: dict[str, float] = {}
        self.label = "waiting for the temperatures"

    def take(self, channels: Mapping[str, ChannelValue], heating: bool) -> None:
        """Take in what the channels read. Raises MotionFailed where one has no valid value."""
        for name, window in self._windows.items():
            read = channels.get(name)
            why = "it is not read" if read is None else read.obstacle
            if read is not None and not why:
                self._invalid_since_s.pop(name, None)
                window.take(read)
                continue
            since_s = self._invalid_since_s.setdefault(name, self._seen_s)
            if heating or self._seen_s - since_s > PATIENCE_S:
                raise MotionFailed(
                    f"{name} has no valid value: {why}; see its sensor and its entry of "
                    "[[channels]], then start again"
                )

    def ended_by(self, passed_s: float, heating: bool) -> str:
        """Return what ends the heat-up or the cooling after `passed_s`, "" for nothing yet.

        Raises MotionFailed for a temperature that stands still while it is heated.
        """
        self._seen_s = passed_s
        own, nodes = self._own, [self._windows[name] for name in self._own.nodes.values()]
        self._show(passed_s)
        if heating and any(window.newest >= own.temperature_max_C for window in nodes):
            return TEMPERATURE_LIMIT
        if heating:
            self._check_moved(passed_s)
        if passed_s >= own.steady_window_s and all(
            (window.changed or not heating) and window.is_steady(own.steady_K_per_min)
            for window in nodes
        ):
            return STEADY
        return TIME_LIMIT if passed_s >= self._limit_s else ""

    def outcome(self) -> dict[str, Any]:
        """Return newest temperatures and slopes, by channel, for the account of a point."""
        slopes = {name: window.slope for name, window in self._windows.items()}
        return {
            "temperatures_C": {name: round(one.newest, 4) for name, one in self._windows.items()},
            "slopes_K_per_min": {
                name: None if one is None else [one.K_per_min, one.half_width_K_per_min]
                for name, one in slopes.items()
            },
        }

    def _check_moved(self, passed_s: float) -> None:
        for name in self._own.nodes.values():
            window = self._windows[name]
            if passed_s > 2 * self._own.steady_window_s and not window.changed:
                raise MotionFailed(
                    f"{name} gives the same {window.newest:g} degC since the heat-up began: is the "
                    "sensor on this motor, is it frozen? see the sensor and its device"
                )
            if window.may_be_frozen(self._own.steady_K_per_min):
                raise MotionFailed(
                    f"{name} gives the same {window.newest:g} degC for {window.still_s:.0f} s, "
                    f"right after it moved by {window.moved_K:+.2g} K: is it frozen? see the "
                    "sensor and its device, then start again"
                )

    def _show(self, passed_s: float) -> None:
        known = all(isfinite(window.newest) for window in self._windows.values())
        if not known or passed_s - self._labelled_s < LABEL_EVERY_S:
            return
        self._labelled_s = passed_s
        parts = [
            f"{name} {window.newest:.1f} degC"
            + (f", {window.slope.K_per_min:+.2g} K/min" if window.slope else "")
            for name, window in self._windows.items()
        ]
        left_min = max(self._limit_s - passed_s, 0.0) / 60
        self.label = f"{'; '.join(parts)}; {left_min:.0f} min left at most"
