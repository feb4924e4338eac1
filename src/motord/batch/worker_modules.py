"""What workers need for any analysis, imported once by the process that they are forked from.

Also what commands import only where they use it, and what numba and pyarrow load at the first call.
No thread of Python may begin here: a forked process does not have it.
"""

import os

import distributed
import pyarrow as pa
import pyarrow.parquet
import scipy.interpolate
from numba.core.registry import cpu_target

import motord.batch.task

__all__ = ["dask_setup", "distributed", "motord", "pyarrow", "scipy"]

pa.array([0.0])
cpu_target.typing_context.refresh()  # what its compiled functions may call, here none yet
cpu_target.target_context.refresh()


def dask_setup(_: distributed.Worker) -> None:
    """Keep what a worker prints off the terminal: outcomes are values. Dask calls it at the start.

    A worker that dies or ends while it starts has tracebacks of Dask's; stdout has the results.
    """
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    os.close(nowhere)
