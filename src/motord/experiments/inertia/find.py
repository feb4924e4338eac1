"""Releases in a recording that does not say where they are: still for a while, then swinging."""

import numpy as np

STILL_S = 0.1
"""How long a bar is still before it is let go."""

STILL_COUNTS = 2
"""Counts that a bar may move by and be still."""


def find_releases(t_ns: np.ndarray, count: np.ndarray, counts: int) -> list[slice]:
    """Return the samples of each stretch that begins with a still bar and goes on until the next.

    t_ns, count (n,); counts: of the encoder's turn. A stretch need not be a swing: the bar may have
    been pulled. Without any stillness, all samples are one stretch.
    """
    t_s = (np.asarray(t_ns, np.int64) - int(t_ns[0])) * 1e-9
    still = _still(t_s, np.asarray(count, np.int64), counts)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    begins, ends = edges[::2], edges[1::2]
    if begins.size == 0:
        return [slice(0, t_s.size)]
    begins = np.maximum(begins, np.searchsorted(t_s, t_s[ends - 1] - STILL_S))
    stops = [*begins[1:], t_s.size]
    return [
        slice(int(begin), int(stop))
        for begin, end, stop in zip(begins, ends, stops, strict=True)
        if stop > end
    ]


def _still(t_s: np.ndarray, count: np.ndarray, counts: int) -> np.ndarray:
    """Return (n,) whether a sample belongs to STILL_S during which the angle hardly changes."""
    steps = np.diff(count)
    steps -= counts * np.rint(steps / counts).astype(np.int64)
    angle = np.concatenate([[0], np.cumsum(steps)])
    still = np.zeros(count.size, bool)
    size = max(int(np.searchsorted(t_s, STILL_S)), 2)
    if count.size < size:
        return still
    windows = np.lib.stride_tricks.sliding_window_view(angle, size)
    calm = np.flatnonzero(windows.max(axis=1) - windows.min(axis=1) <= STILL_COUNTS)
    marks = np.zeros(count.size + 1, np.int64)
    np.add.at(marks, calm, 1)
    np.add.at(marks, calm + size, -1)
    return np.asarray(np.cumsum(marks)[:-1] > 0)
