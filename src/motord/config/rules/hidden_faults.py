"""What is dead may go unnoticed by legal limits: notes for `motord check`, no reason to refuse."""

from collections.abc import Iterator

import numpy as np

from motord.config.bounds import rounded_down
from motord.config.rules.interlocks import dead_sensor_error_Nm
from motord.config.sections import LimitsConfig, Sections

LEAST_CURRENT = 0.02
"""Of [limits] current_A: a smaller error is noise."""


def hidden_faults(bench: Sections) -> list[str]:
    """Return which dead sensor or drive may go unnoticed by these limits, and what would show it.

    Neither is wrong: a gentle ramp, a low limit or a sensor's high-pass leave little to see.
    """
    currents_A = bench.motor.largest_currents_A(bench.limits.torque_Nm)
    return [*_hidden_drive(bench, currents_A), *_hidden_torque_sensor(bench, currents_A)]


def _hidden_drive(bench: Sections, currents_A: np.ndarray) -> Iterator[str]:
    limits, least_A = bench.limits, min(float(currents_A.min()), bench.limits.current_A)
    if limits.greatest_current_error_A < least_A:
        return
    shown = "nothing would show it there"
    if least_A > LEAST_CURRENT * limits.current_A:
        shown = f"current_error_A less than {rounded_down(least_A):g} would show it"
    yield (
        f"a drive without any current may go unnoticed: [limits] torque_Nm takes no more than "
        f"{least_A:.3g} A at some angles, and {limits.greatest_current_error_A:g} A may be "
        f"missing; {shown}"
    )


def _hidden_torque_sensor(bench: Sections, currents_A: np.ndarray) -> Iterator[str]:
    limits, tau_s = bench.limits, bench.torque_sensor.highpass_time_constant_s
    share = limits.current_A / max(float(currents_A.max()), limits.current_A)
    reached_Nm = limits.torque_Nm * share
    reached = limits.model_copy(update={"torque_Nm": reached_Nm})
    dead_Nm = dead_sensor_error_Nm(reached, tau_s)
    if limits.greatest_torque_error_Nm < dead_Nm:
        return
    remedies = [f"torque_error_Nm less than {rounded_down(dead_Nm):g}"] if dead_Nm > 0 else []
    remedies += _changes_that_show_it(bench, reached)
    cause = f"[limits] let no more than {reached_Nm:.3g} Nm be reached"
    if tau_s:
        cause = (
            f"its high-pass of {tau_s:g} s leaves too little of the {reached_Nm:.3g} Nm that "
            f"[limits] let be reached at {limits.torque_rate_Nm_per_s:g} Nm/s"
        )
    yield (
        f"a torque sensor that stays at zero may go unnoticed: {cause}; what would show it: "
        + (" or ".join(remedies) or "nothing")
    )


def _changes_that_show_it(bench: Sections, reached: LimitsConfig) -> list[str]:
    """Return what would show a sensor at zero up to `reached`'s torque, alone, else together."""
    tau_s = bench.torque_sensor.highpass_time_constant_s
    shortest_s = bench.inverter.settling_s + 1.0 / bench.loop.rate_Hz + bench.sample_interval_s
    faster, shorter = {"torque_rate_Nm_per_s": 1e12}, {"torque_error_s": shortest_s}
    changes = {
        "a faster torque_rate_Nm_per_s": faster,
        "a shorter torque_error_s": shorter,
        "both a faster torque_rate_Nm_per_s and a shorter torque_error_s": faster | shorter,
    }
    showing = [
        name
        for name, change in changes.items()
        if bench.limits.greatest_torque_error_Nm
        < dead_sensor_error_Nm(reached.model_copy(update=change), tau_s)
    ]
    return showing[:-1] or showing  # together they show what one of them does, too
