"""Tick kernel: what the loop computes in a tick, bookkeeping and control, compiled into one call.

The control kernel takes nine arrays, and checking these costs a call far more than the kernel
itself. They are the same in every tick, so a compiled function finds them by their addresses.
"""

import numpy as np

from motord.control import step as kernel
from motord.control.types import COMMAND, FEEDBACK, MEMORY, PARAMETERS, SETPOINT
from motord.jit import ArgumentBlock, jit_holding_gil, records_at
from motord.learned import COEFFICIENTS_MAX
from motord.schema import TICK_DTYPE
from motord.shm.tables import TableSet
from motord.shm.time_count import count_time
from motord.shm.timing import TIMING

_PARAMETERS, _BACK_EMF, _COGGING, _LEARNED = range(4)
_MEMORY, _FEEDBACK, _SETPOINT, _COMMAND, _RING, _TIMING = range(4, 10)
_FLOAT64, _INT64 = np.dtype(np.float64), np.dtype(np.int64)
_WORDS = TICK_DTYPE.itemsize // _INT64.itemsize
NO_WORK = -1
"""Work time to hand over in the first tick: there was none before it."""


@jit_holding_gil
def run_tick(
    frame: int, index: int, tick: int, missed: int, flags: int, wake_late_ns: int, work_ns: int
) -> None:
    """Run the kernel into slot `index` of the ring, with what is known of the tick's timing.

    The slot, which holds an old tick, is cleared before: a field that nobody fills is zero.
    """
    parameters = records_at(frame, _PARAMETERS, 1, PARAMETERS)
    counts = parameters[0].counts
    back_emf = records_at(frame, _BACK_EMF, 3 * counts, _FLOAT64).reshape(counts, 3)
    records_at(frame, _RING, (index + 1) * _WORDS, _INT64)[index * _WORDS :] = 0
    records = records_at(frame, _RING, index + 1, TICK_DTYPE)[index:]
    record = records[0]
    record.tick = tick
    record.missed = missed
    record["flags"] = flags  # not record.flags: numpy has an attribute of that name
    record.wake_late_ns = wake_late_ns
    record.work_ns = max(work_ns, 0)
    kernel.step(
        parameters,
        back_emf,
        records_at(frame, _COGGING, counts, _FLOAT64),
        records_at(frame, _LEARNED, COEFFICIENTS_MAX, _FLOAT64),
        records_at(frame, _MEMORY, 1, MEMORY),
        records_at(frame, _FEEDBACK, 1, FEEDBACK),
        records_at(frame, _SETPOINT, 1, SETPOINT),
        records_at(frame, _COMMAND, 1, COMMAND),
        records,
    )
    timing = records_at(frame, _TIMING, 1, TIMING)[0]
    timing.missed = missed
    count_time(timing.wake_late, wake_late_ns)
    if work_ns >= 0:
        count_time(timing.work, work_ns)


class TickKernel:
    """`run_tick` with all that it works on; `frame` is what to hand to it.

    `memory`, `feedback`, `setpoint`, `command` and `timing` have shape (1,), `ring` all slots.
    """

    def __init__(
        self,
        tables: TableSet,
        timing: np.ndarray,
        memory: np.ndarray,
        feedback: np.ndarray,
        setpoint: np.ndarray,
        command: np.ndarray,
        ring: np.ndarray,
    ) -> None:
        self._frame = ArgumentBlock(*tables, memory, feedback, setpoint, command, ring, timing)
        self.frame = self._frame.address

    def use(self, tables: TableSet) -> None:
        """Let the kernel use other tables of the same size."""
        for place, table in enumerate(tables):
            self._frame.replace(place, table)
