"""Encoder counts that jump away for few samples and come back: no rotor does.

A jump is far beyond the usual step between samples. Each misread sample makes two jumps: where one
of 40 is misread, the 95th percentile of all steps is that of jumps. Usual are therefore the steps
that are no jumps among those nearby, of which a low quantile stays.
"""

import numpy as np

MISREAD_MIN = 3
"""Samples that are off by themselves from which on an encoder is misread, not disturbed once."""
MISREAD_STEPS, MISREAD_COUNTS = 3.0, 8
"""A jump is so many usual steps, and counts, from one sample to the next."""
USUAL_PERCENT = 95.0
"""Of the steps that are not jumps, those that are smaller than usual."""
NEARBY = 64
"""Steps that are compared with each other: within them the speed hardly changes."""
NEARBY_PERCENT = 35.0
"""Of the steps nearby: as many are between sound samples where four of ten samples are misread."""
SPREAD = 2.0
"""So many times larger all steps are than those without jumps, where samples are misread: noise and
vibration make less of a difference."""
LONGEST = 5
"""Samples that are misread one after the other at most, where single ones are as well."""


def misread(count: np.ndarray, counts: int) -> np.ndarray:
    """Return which counts (n,) are far from their neighbours, those near each other (n,).

    A gap in the recording is none. Several in a row count only next to MISREAD_MIN single ones.
    """
    if count.size < 3:
        return np.zeros(count.size, bool)
    step = _apart(count[1:], count[:-1], counts)
    if _none_far(step):
        return np.zeros(count.size, bool)
    nearby = _far_nearby(step)
    each = np.full(step.size, _far_of_sound(count, step, nearby, counts))
    off = _excursions(count, step, each, each, counts, 1)
    if off.sum() >= MISREAD_MIN:
        each = np.maximum(each, nearby)
        off |= _excursions(count, step, each, 2 * each, counts, LONGEST)
    return off


def misread_in_rows(count: np.ndarray, counts: int) -> np.ndarray:
    """Return which counts (n,) jump away and back, one or up to LONGEST in a row (n,).

    Also without single ones. They are back within as many usual steps as samples have passed: two
    gaps in the recording, which are no misread counts, lead on.
    """
    off = np.zeros(count.size, bool)
    if count.size < 3:
        return off
    step = _apart(count[1:], count[:-1], counts)
    if _none_far(step):
        return off
    nearby = _far_nearby(step)
    if not (step > nearby).any():
        return off
    each = np.maximum(nearby, _far_of_sound(count, step, nearby, counts))
    return _excursions(count, step, each, 2 / MISREAD_STEPS * each, counts, LONGEST)


def _none_far(step: np.ndarray) -> bool:
    """Return whether no step (n,) can be a jump, whatever is usual: most rotors turn so slowly."""
    return bool(step.max() <= MISREAD_COUNTS and step.min() >= 0)


def far_from(step: np.ndarray) -> float:
    """Return from which distance on a sample is off, by the usual steps (n,) between samples."""
    return MISREAD_STEPS * float(np.percentile(step, USUAL_PERCENT)) + MISREAD_COUNTS


def _far_of_sound(count: np.ndarray, step: np.ndarray, nearby: np.ndarray, counts: int) -> float:
    """Return from which distance on a sample is off, by the steps (n - 1,) that are no jumps.

    step, nearby (n - 1,): what counts (n,) are apart, and from where on that is a jump.
    """
    far = far_from(step)
    if not (step > nearby).any():
        return far
    off = _excursions(count, step, nearby, nearby, counts, LONGEST)
    still = ~(off[1:] | off[:-1])
    sound = far_from(step[still]) if still.any() else far
    return sound if far > SPREAD * sound else far


def _far_nearby(step: np.ndarray) -> np.ndarray:
    """Return from which distance on each of the steps (n,) is a jump among those around it (n,)."""
    whole = np.pad(step, (0, -step.size % NEARBY), mode="symmetric").reshape(-1, NEARBY)
    at = int(NEARBY_PERCENT / 100 * NEARBY)
    usual = np.partition(whole, at, axis=1)[:, at]
    return np.repeat(MISREAD_STEPS * usual + MISREAD_COUNTS, NEARBY)[: step.size]


def _excursions(
    count: np.ndarray,
    step: np.ndarray,
    far: np.ndarray,
    near: np.ndarray,
    counts: int,
    longest: int,
) -> np.ndarray:
    """Return which counts (n,) are between a jump away and one back, `longest` samples at most.

    step (n - 1,): what counts are apart; far (n - 1,): more is a jump; near (n - 1,): by which two
    samples may differ that have one between them. The shortest first: a sample between two that
    are misread alike is off as well.
    """
    jump, off = step > far, np.zeros(count.size, bool)
    for samples in range(1, longest + 1):
        away = np.flatnonzero(jump[:-samples] & jump[samples:])
        back = away + samples + 1
        apart = _apart(count[back] % counts, count[away] % counts, counts)
        away = away[apart <= near[away] * (samples + 1) / 2]
        for n in range(samples):
            off[away + 1 + n] = True
        for n in range(samples + 1):
            jump[away + n] = False
    return off


def _apart(count: np.ndarray, other: np.ndarray, counts: int) -> np.ndarray:
    """Return how far counts (n,) are apart, the shorter way round."""
    difference = np.abs(count - other)
    return np.asarray(np.minimum(difference, counts - difference))
