"""`align`: a current vector turns slowly and takes the rotor along, forwards and back.

Nothing of where the rotor is enters the currents: torque is zero, and the vector is put on the
phases as it is. So this works on a bench whose phase order and encoder are not known yet.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from motord.config import AlignConfig, Config
from motord.config.back_emf import BackEmfTable
from motord.experiments.alignment.sweep import Sweep, TakeSweep
from motord.sequencing.settings import PlanError, chosen
from motord.sequencing.steps import Enable, OperatingPoint, Plan, Rest, Steps

NAME = "align"

RATED_PARTS = (0.2, 0.4)
"""Currents unless others are set, in parts of the current that makes the rated torque."""


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.align]` with `settings`. Raises PlanError."""
    own = chosen(NAME, config.plans.align, settings)
    if config.inverter.driver == "can-dq":
        raise PlanError(
            f"{NAME}: a drive that takes currents along d and q has an angle of its own, by which "
            "the current vector would turn: align it by its own tool, and tell [inverter.dq]"
        )
    if isinstance(config.motor.back_emf, BackEmfTable):
        raise PlanError(
            f"{NAME}: [motor] back_emf is a measured table, which has direction and zero in it: "
            "there is nothing to align; name harmonics to align anew"
        )
    own = own.model_copy(update={"currents_A": currents_A(config, own)})
    _check_currents(config, own)
    sweeps = tuple(Sweep(amplitude_A, way) for amplitude_A in own.currents_A for way in (1, -1))
    return Plan(
        name=NAME,
        points=tuple(
            OperatingPoint(index, 0.0, 0.0, 0, aim=sweep.aim) for index, sweep in enumerate(sweeps)
        ),
        make_steps=partial(_steps, own, sweeps, config.motor.pole_pairs),
        estimate_s=partial(_seconds, own, sweeps, config.motor.pole_pairs),
        settings=own.model_dump(mode="json"),
        needs="",
    )


def currents_A(config: Config, own: AlignConfig) -> tuple[float, ...]:
    """Return the amplitudes of the vector (A), smallest first."""
    if own.currents_A:
        return tuple(sorted(own.currents_A))
    table = config.motor.back_emf_table()
    rms_V_s_per_rad = math.sqrt(float((table**2).mean()))
    rated_A = math.sqrt(2) / 3 * config.motor.rated_torque_Nm / rms_V_s_per_rad
    return tuple(float(np.round(part * rated_A, 2)) for part in RATED_PARTS)


def _check_currents(config: Config, own: AlignConfig) -> None:
    largest_A, limits = max(own.currents_A), config.limits
    for name, limit_A in (
        ("current_A", limits.current_A),
        ("i2t_current_A", limits.i2t_current_A),
    ):
        if largest_A > limit_A:
            raise PlanError(f"{NAME}: {largest_A:g} A is above [limits] {name} = {limit_A:g}")


def _steps(
    own: AlignConfig, sweeps: tuple[Sweep, ...], pole_pairs: int, points: tuple[OperatingPoint, ...]
) -> Steps:
    yield Enable()
    for point in points:
        yield TakeSweep(point, sweeps[point.index], own, pole_pairs)
    yield Rest()


def _seconds(
    own: AlignConfig, sweeps: tuple[Sweep, ...], pole_pairs: int, points: tuple[OperatingPoint, ...]
) -> float:
    taken = (TakeSweep(point, sweeps[point.index], own, pole_pairs) for point in points)
    return Enable().seconds() + Rest().seconds() + sum(step.seconds() for step in taken)
