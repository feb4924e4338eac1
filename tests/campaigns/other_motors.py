"""Rigs of the campaigns with other motors than the packaged one: gains and offsets are random."""

from typing import TypeVar

import numpy as np

from motord.config import Config, load
from motord.config.base import Section
from motord.config.motor.back_emf import BackEmfHarmonic
from motord.rig.truth import RigTruth, TorqueHarmonicTruth
from tests.campaigns.estimator import rig

MOTORS = ("48/16", "star", "36/12")
"""Slots and poles: the packaged motor, the same in a star, one with another winding and encoder."""

BACK_EMF = ((1, 0.27, 0.0), (3, 0.012, 0.2), (5, 0.004, 0.0))
COGGING_NM = {12: 0.06, 36: 0.25, 72: 0.04}
COUNTS = 5000

Whole = TypeVar("Whole", bound=Section)


def rig_of(name: str, seed: int) -> tuple[Config, RigTruth, float, float]:
    """Return a bench with one of MOTORS, what is true of it, its delta and epsilon."""
    config, (truth, delta, epsilon) = load(), rig(seed)
    if name == MOTORS[0]:
        return config, truth, delta, epsilon
    rng = np.random.default_rng([seed, MOTORS.index(name)])
    gains = {"alpha": tuple(rng.uniform(0.85, 1.15, 3)), "beta_A": tuple(rng.uniform(-1, 1, 3))}
    truth = _with(truth, "inverter", **gains)
    if name == "star":
        star = {"connection": "star"}
        truth = _with(truth, "motor", **star)
        return _with(config, "motor", name=name, **star), truth, delta, epsilon
    keys = ("order", "amplitude_V_s_per_rad", "phase_rad")
    emf = tuple(BackEmfHarmonic(**dict(zip(keys, one, strict=True))) for one in BACK_EMF)
    cogging = tuple(
        TorqueHarmonicTruth(order=order, amplitude_Nm=size_Nm, phase_rad=rng.uniform(-3, 3))
        for order, size_Nm in COGGING_NM.items()
    )
    known = {"pole_pairs": 6, "back_emf": emf}
    truth = _with(truth, "motor", **known, cogging=cogging)
    truth = _with(_with(truth, "encoder", counts=COUNTS), "rotor", inertia_kg_m2=0.02)
    config = _with(config, "motor", name=name, slots=36, counts=COUNTS, **known)
    return config, truth, delta, epsilon


def _with(whole: Whole, part: str, **fields: object) -> Whole:
    changed = getattr(whole, part).model_copy(update=fields)
    return whole.model_copy(update={part: changed})
