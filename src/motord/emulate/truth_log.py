"""What the emulated rig truly did, row by row, passed on in blocks."""

from collections.abc import Callable

import numpy as np

from motord.schema import TRUTH_DTYPE

BLOCK_S = 0.5

TruthSink = Callable[[np.ndarray], None]


class TruthLog:
    """Collects rows of TRUTH_DTYPE; a full block goes to `sink`, and into the mean torque.

    `rows` counts them, `on_rows` those with the power stage on, up to the last flush.
    """

    def __init__(self, rate_Hz: int, sink: TruthSink | None) -> None:
        self._sink = sink
        self._block = np.zeros(max(1, round(BLOCK_S * rate_Hz)), TRUTH_DTYPE)
        self._used = 0
        self._torque_sum_Nm = 0.0
        self.on_rows = 0
        self.rows = 0

    def next_row(self) -> np.record:
        """Return the next row, to be filled at once."""
        if self._used == len(self._block):
            self.flush()
        row: np.record = self._block[self._used]
        self._used += 1
        self.rows += 1
        return row

    def flush(self) -> None:
        """Pass on the rows collected so far."""
        rows = self._block[: self._used]
        self._used = 0
        if not len(rows):
            return
        on = rows["inverter_on"] != 0
        self._torque_sum_Nm += float(rows["torque_Nm"][on].sum(dtype=np.float64))
        self.on_rows += int(on.sum())
        if self._sink is not None:
            self._sink(rows.copy())

    @property
    def mean_torque_Nm(self) -> float | None:
        """Return the mean true torque while the power stage was on, up to the last flush."""
        return self._torque_sum_Nm / self.on_rows if self.on_rows else None
