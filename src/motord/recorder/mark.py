"""How far a recording goes; loads nothing that reads or writes one."""

from dataclasses import dataclass

import numpy as np

_FIELDS = ("tick", "t_ns", "missed")


@dataclass(frozen=True)
class Mark:
    """The last tick that is in a file."""

    tick: int
    t_ns: int
    missed: int

    @classmethod
    def of(cls, tick: np.void) -> "Mark":
        """Return the mark of a tick, a record with fields `tick`, `t_ns` and `missed`."""
        return cls(*(int(tick[name]) for name in _FIELDS))

    @classmethod
    def of_last(cls, ticks: np.ndarray) -> "Mark":
        """Return the mark of the last of `ticks` (n,), n > 0; faster than to take it out before."""
        return cls(*(ticks[name].item(-1) for name in _FIELDS))
