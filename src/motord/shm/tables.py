"""Parameters and tables of the control kernel, swapped by the loop between two ticks.

Two complete sets and a version whose lowest bit names the set in force. The loop compares the
version once a tick, changes its views and acknowledges; only then is the other set free for the
next write, so no table ever changes under a running kernel.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from motord.control.types import PARAMETERS
from motord.learned import COEFFICIENTS_MAX
from motord.schema import record_dtype
from motord.shm.memory_barrier import memory_barrier
from motord.shm.shared_records import FIRST_WORD, LINE_WORDS, SharedFile, layout_digest

KIND = "tables"
_COUNTS = FIRST_WORD
_VERSION = 2 * LINE_WORDS
_IN_USE = 4 * LINE_WORDS


class TablesBusyError(Exception):
    """The loop has not yet taken up the set written before."""


class TableSet(NamedTuple):
    """Arguments of the kernel.

    parameters (1,), back-EMF (counts, 3), cogging (counts,), learned torque
    (COEFFICIENTS_MAX,).
    """

    parameters: np.ndarray
    back_emf_V_s_per_rad: np.ndarray
    cogging_Nm: np.ndarray
    learned_Nm: np.ndarray


def _set_dtype(counts: int) -> np.dtype[np.void]:
    return record_dtype(
        [
            ("parameters", PARAMETERS, (1,)),
            ("back_emf_V_s_per_rad", "f8", (counts, 3)),
            ("cogging_Nm", "f8", (counts,)),
            ("learned_Nm", "f8", (COEFFICIENTS_MAX,)),
        ]
    )


_LAYOUT = layout_digest(_set_dtype(1))


def _sets(shared: SharedFile, counts: int) -> list[TableSet]:
    both = shared.array(_set_dtype(counts), 2, 0)
    return [TableSet(*(both[name][side] for name in TableSet._fields)) for side in (0, 1)]


class TablesWriter:
    """The only writer of the tables, made anew at `path` for an encoder of `counts` counts."""

    def __init__(self, path: Path, counts: int) -> None:
        self._file = SharedFile.create(
            path, KIND, _LAYOUT, [counts], 2 * _set_dtype(counts).itemsize
        )
        self.counts = counts
        self._words = self._file.words
        self._sets = _sets(self._file, counts)

    @property
    def version(self) -> int:
        """Number of the set written last; 0 before the first."""
        return self._words[_VERSION]

    @property
    def in_use(self) -> int:
        """Number of the set that the loop uses; 0 while there is no loop."""
        return self._words[_IN_USE]

    def write(
        self,
        parameters: np.ndarray,
        back_emf_V_s_per_rad: np.ndarray,
        cogging_Nm: np.ndarray,
        learned_Nm: np.ndarray,
    ) -> int:
        """Put a set in force and return its version; shapes as in TableSet.

        Raises TablesBusyError while a loop has yet to take up the set before (at most a tick, if
        it runs), ValueError for tables of another size.
        """
        version = self.version
        shapes = back_emf_V_s_per_rad.shape, cogging_Nm.shape, learned_Nm.shape
        if shapes != ((self.counts, 3), (self.counts,), (COEFFICIENTS_MAX,)):
            raise ValueError(
                f"tables are {shapes[0]}, {shapes[1]} and {shapes[2]}, "
                f"expected ({self.counts}, 3), ({self.counts},) and ({COEFFICIENTS_MAX},)"
            )
        if self.in_use not in (0, version):
            raise TablesBusyError("the loop has not yet taken up the tables written before")
        given = (parameters, back_emf_V_s_per_rad, cogging_Nm, learned_Nm)
        for table, values in zip(self._sets[(version + 1) & 1], given, strict=True):
            table[:] = values
        memory_barrier()
        self._words[_VERSION] = version + 1
        memory_barrier()
        return version + 1

    def forget_loop(self) -> None:
        """Say that the loop is gone; the next one acknowledges for itself."""
        self._words[_IN_USE] = 0


class TablesReader:
    """The loop's end. `current` is the set in force after `poll()` returned True."""

    def __init__(self, path: Path) -> None:
        self._file = SharedFile.attach(path, KIND, _LAYOUT, writable=True)
        self._words = self._file.words
        self.counts = int(self._words[_COUNTS])
        self._sets = _sets(self._file, self.counts)
        self._version = 0
        self.current = self._sets[0]

    def poll(self) -> bool:
        """Take up a new set, if there is one, and return whether there was."""
        words = self._words
        if words[_VERSION] == self._version:
            return False
        while words[_VERSION] != self._version:  # a write may have come before we acknowledged
            self._version = words[_VERSION]
            words[_IN_USE] = self._version
            memory_barrier()
        self.current = self._sets[self._version & 1]
        return True
