"""What workers need for any analysis, imported once by the process that they are forked from.

Also what commands import only where they use it, and what numba and pyarrow load at the first call.
No thread of Python may begin here: a forked process does not have it.
"""

import distributed
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import scipy.interpolate

import motord.batch.task
from motord.identification.resample import interpolate

__all__ = ["distributed", "motord", "pyarrow", "scipy"]

pa.array([0.0])
interpolate(np.arange(4.0), np.zeros((4, 1)), np.ones(1), np.zeros((1, 1)))
