"""What workers need for any analysis, imported once by the process that they are forked from.

Also what commands import only where they use it, and what numba and pyarrow load at the first call.
No thread of Python may begin here: a forked process does not have it.
"""

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
