"""Timing of the currents against the samples of the torque, by bench file or recording."""

from collections.abc import Mapping
from typing import Any, Unpack

import numpy as np

from motord.config import LoopConfig
from motord.config.devices import InverterConfig
from motord.identification.aliased_ripple import ZeroOrderHold
from motord.identification.resample import rising
from motord.recording.reader import Bounds, Run
from motord.untrusted import parse_toml


def zero_order_hold(
    inverter: InverterConfig, period_s: float, sample_age_s: float = 0.0
) -> ZeroOrderHold:
    """Return the timing of the currents for samples of that age when the tick begins."""
    dead_s = sample_age_s + inverter.actuation_delay_s - inverter.lag_s
    return ZeroOrderHold(dead_s, inverter.lag_s, period_s)


def recorded_hold(run: Run, **bounds: Unpack[Bounds]) -> ZeroOrderHold | None:
    """Return the timing of the currents in a run; None if its bench file does not say.

    bounds: of the time whose samples say how old they are; all of it without.
    """
    try:
        bench = parse_toml(run.metadata["config"])
        table, period_s = bench["inverter"], loop_period_s(bench)
        given = {name: table[name] for name in ("actuation_delay_s", "lag_s") if name in table}
        inverter = InverterConfig.model_validate(given)
    except (AttributeError, KeyError, TypeError, ValueError):
        return None
    if "actuation_delay_s" not in given:
        return None
    ticks = run.ticks(("t_ns", "sample_age_ns"), **bounds)
    age_ns = ticks["sample_age_ns"][rising(ticks["t_ns"])]
    age_s = float(np.median(age_ns)) * 1e-9 if age_ns.size else 0.0
    return zero_order_hold(inverter, period_s, age_s)


def phase_hold(run: Run, **bounds: Unpack[Bounds]) -> ZeroOrderHold | None:
    """Return the timing of held phase currents; None without their lag, or of a drive with axes.

    Images depend on the lag of the current loops; a drive that takes currents along the rotor's
    axes turns them between commands.
    """
    hold = recorded_hold(run, **bounds)
    if hold is None or not hold.lag_s:
        return None
    rotating = parse_toml(run.metadata["config"])["inverter"].get("driver") == "can-dq"
    return None if rotating else hold


def loop_period_s(bench: Mapping[str, Any]) -> float:
    """Return the time for which the loop of a bench file holds each command. Raises ValueError."""
    return 1.0 / LoopConfig.model_validate(bench.get("loop", {})).rate_Hz
