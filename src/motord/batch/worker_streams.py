"""What a worker prints goes nowhere: outcomes are values, and stdout is the command's."""

import os
from typing import Any


def dask_setup(_worker: Any) -> None:
    """Give this worker's stdout and stderr to /dev/null; Dask calls it before any task.

    A worker that dies or ends while it starts has tracebacks of Dask's own to print.
    """
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    os.close(nowhere)
