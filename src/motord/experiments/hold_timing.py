"""Timing of the currents against the samples of the torque, by bench file or recording."""

import numpy as np

from motord.config import LoopConfig
from motord.config.devices import InverterConfig
from motord.identification.aliased_ripple import ZeroOrderHold
from motord.recording.reader import Run
from motord.untrusted import parse_toml


def zero_order_hold(inverter: InverterConfig, sample_age_s: float = 0.0) -> ZeroOrderHold:
    """Return the timing of the currents for samples of that age when the tick begins."""
    dead_s = sample_age_s + inverter.actuation_delay_s - inverter.lag_s
    return ZeroOrderHold(dead_s, inverter.lag_s)


def recorded_hold(run: Run) -> ZeroOrderHold | None:
    """Return the timing of the currents in a run; None if its bench file does not say."""
    try:
        table = parse_toml(run.metadata["config"])["inverter"]
        given = {name: table[name] for name in ("actuation_delay_s", "lag_s") if name in table}
        inverter = InverterConfig.model_validate(given)
    except (KeyError, TypeError, ValueError):
        return None
    if "actuation_delay_s" not in given:
        return None
    age_ns = run.ticks(("sample_age_ns",))["sample_age_ns"]
    return zero_order_hold(inverter, float(np.median(age_ns)) * 1e-9 if age_ns.size else 0.0)


def phase_hold(run: Run) -> ZeroOrderHold | None:
    """Return the timing of held phase currents; None without their lag, or of a drive with axes.

    Images depend on the lag of the current loops; a drive that takes currents along the rotor's
    axes turns them between commands.
    """
    hold = recorded_hold(run)
    if hold is None or not hold.lag_s:
        return None
    rotating = parse_toml(run.metadata["config"])["inverter"].get("driver") == "can-dq"
    return None if rotating else hold


def loop_period_s(run: Run) -> float:
    """Return the time for which the loop of a run held each command."""
    loop = parse_toml(run.metadata["config"]).get("loop", {})
    return 1.0 / float(loop.get("rate_Hz", LoopConfig().rate_Hz))
