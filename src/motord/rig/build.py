"""From the truth of a rig to the records that its kernels step."""

import numpy as np

from motord.rig.truth import RigTruth


def build(
    truth: RigTruth, seed: int, substep_s: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return (parameters, state) of a rig at rest, shapes (1,), RIG_PARAMETERS and RIG_STATE.

    `seed` starts its random numbers; `substep_s` overrides the step of the integration.
    """
    ...
