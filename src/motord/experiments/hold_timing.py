"""Timing of the currents against the ticks of the loop, by bench file or recording."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from math import isnan, nan
from typing import Any

from motord.config import LoopConfig
from motord.config.devices import InverterConfig
from motord.identification.aliased_ripple import ZeroOrderHold
from motord.recording.reader import Run
from motord.untrusted import parse_toml


def zero_order_hold(inverter: InverterConfig, period_s: float) -> ZeroOrderHold:
    """Return the timing of the currents of a loop."""
    dead_s = inverter.actuation_delay_s - inverter.lag_s
    return ZeroOrderHold(dead_s, inverter.lag_s, period_s)


def recorded_hold(run: Run) -> ZeroOrderHold | None:
    """Return the timing of the currents in a run; None without a bench file that can be read.

    The dead time, of phase currents, is nan where that does not say `actuation_delay_s`, and of a
    drive that takes currents along the rotor's axes: it turns them between commands.
    """
    try:
        return _hold(run.metadata["config"])
    except (AttributeError, KeyError, TypeError, ValueError):
        return None


@lru_cache(maxsize=4)  # an analysis asks for it in each repetition of a soak
def _hold(text: str) -> ZeroOrderHold:
    """Return the timing by the text of a bench file, as `recorded_hold` does."""
    bench = parse_toml(text)
    table, period_s = bench["inverter"], loop_period_s(bench)
    given = {name: table[name] for name in ("actuation_delay_s", "lag_s") if name in table}
    hold = zero_order_hold(InverterConfig.model_validate(given), period_s)
    known = "actuation_delay_s" in given and table.get("driver") != "can-dq"
    return hold if known else replace(hold, dead_s=nan)


def phase_hold(run: Run) -> ZeroOrderHold | None:
    """Return the timing of held phase currents; None where dead time or lag is not known.

    Images depend on the lag of the current loops.
    """
    hold = recorded_hold(run)
    return None if hold is None or isnan(hold.dead_s) or not hold.lag_s else hold


def loop_period_s(bench: Mapping[str, Any]) -> float:
    """Return the time for which the loop of a bench file holds each command. Raises ValueError.

    Nothing else of the loop counts: a recording may be older than a bound of today.
    """
    given = {name: value for name, value in bench.get("loop", {}).items() if name == "rate_Hz"}
    return 1.0 / LoopConfig.model_validate(given).rate_Hz
