"""What workers need for any analysis, imported once by the process that they are forked from.

Also what commands import only where they use it, and what numba and pyarrow load at the first call.
No thread of Python may begin here: a forked process does not have it.
"""

import os
from typing import Any

import distributed
import pyarrow as pa
import pyarrow.parquet
import scipy.interpolate
from numba.core.registry import cpu_target

import motord.batch.task

__all__ = ["distributed", "motord", "pyarrow", "scipy"]

pa.array([0.0])
cpu_target.typing_context.refresh()  # what its compiled functions may call, here none yet
cpu_target.target_context.refresh()


def dask_setup(_worker: Any) -> None:
    """Give this worker's stdout and stderr to /dev/null; Dask calls it before any task.

    Outcomes are values, and stdout is the command's. A worker that dies or ends while it starts has
    tracebacks of Dask's own to print.
    """
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    os.close(nowhere)
