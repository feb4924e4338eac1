"""How far a recording goes; loads nothing that reads or writes one."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Mark:
    """The last tick that is in a file."""

    tick: int
    t_ns: int
    missed: int

    @classmethod
    def of(cls, tick: np.void) -> "Mark":
        """Return the mark of a tick, a record with fields `tick`, `t_ns` and `missed`."""
        return cls(*(int(tick[name]) for name in ("tick", "t_ns", "missed")))
