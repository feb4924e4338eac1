"""The compiler of the numerical kernels: numba, with a cache that knows all their sources."""

import ctypes
import hashlib
import os
import warnings
from collections import namedtuple
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import IO, Any, TypeVar, cast

import numpy as np

from motord.process.hidden_packages import hidden

# to count lines that it compiles, for settings in the working folder, for colours, for a version
with hidden("coverage", "yaml", "colorama", "scipy"):
    # of settings that it then does not read it says: install what is hidden here
    warnings.filterwarnings("ignore", "A Numba config file is found", UserWarning)
    import numba
from numba.core import caching
from numba.core.runtime.nrt import rtsys
from numba.extending import intrinsic

from motord.kernel_cache import PACKAGE, claim, not_kept, usable_kernel_cache

_Kernel = TypeVar("_Kernel", bound=Callable[..., object])

_CACHING: Any = caching
_FOLDER = usable_kernel_cache()
_READ_ONLY = _FOLDER.exists() and not os.access(_FOLDER, os.W_OK)
numba.config.CACHE_DIR = str(_FOLDER)  # type: ignore[attr-defined]


class _Locator(_CACHING.CompileResultCacheImpl._locator_classes[0]):  # type: ignore[misc]
    """Finds a kernel in the folder, which numba else leaves alone where it cannot write to it."""

    def ensure_cache_path(self) -> None:
        if not _READ_ONLY:
            super().ensure_cache_path()

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return the folder of a module: of this package its name, wherever it is installed."""
        folder = Path(py_file).parent
        if not folder.is_relative_to(PACKAGE):
            return str(super().get_suitable_cache_subpath(py_file))
        return ".".join(("motord", *folder.relative_to(PACKAGE).parts))

    def get_source_stamp(self) -> bytes:
        """Return a digest of the module: one edited after the folder was named is another one.

        Older releases of numba take its time and size, which each installation has of its own.
        """
        return hashlib.sha256(Path(self._py_file).read_bytes()).digest()

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> "_Locator | None":
        """Return where a function's machine code is kept, None if it has no source file.

        Raises OSError, which says what to do, if it cannot be. Numba would try the folder of the
        source next, where an edit of an inlined function goes unnoticed.
        """
        if not Path(py_file).exists():
            return None
        place = cls(py_func, py_file)
        try:
            place.ensure_cache_path()
        except OSError as error:
            raise not_kept(error, Path(place.get_cache_path())) from None
        return place


class _Located(_CACHING.CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator, *_CACHING.CompileResultCacheImpl._locator_classes[1:])


class _KernelCache(_CACHING.FunctionCache):  # type: ignore[misc]
    """Kept machine code of a kernel; a folder that is read-only is only read.

    What is not kept yet is compiled by one process, for which others wait: a daemon's processes
    start at once. Raises OSError, which says what to do, where it cannot be kept.
    """

    _impl_class = _Located
    _claim: IO[bytes] | None = None
    _waits = True
    """Until one was waited for in vain: it may be stopped, with those that call it claimed, too."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        kept = self._kept(sig, target_context)
        claimed = self._claim is not None  # as compiling it for other arguments failed
        if kept is None and not claimed and not _READ_ONLY and self._waits:
            self._claim = claim(Path(self.cache_path) / f"{self._impl.filename_base}.lock")
            _KernelCache._waits = self._claim is not None
            kept = self._kept(sig, target_context)
        if kept is not None:
            self._release()
        return kept

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return numba's key without the bytecode, which `python -OO` makes another one.

        All that decides on the machine code is in the digest of the module, in the name and first
        line of the function, by which numba names the files, and in the closure. Two lambdas of one
        line would be one kernel.
        """
        arguments, machine, (_, closure) = super()._index_key(sig, codegen)
        return arguments, machine, closure

    def _kept(self, sig: Any, target_context: Any) -> Any:
        """Return what is kept, None if nothing is; as numba does, but without its compiler.

        Numba loads all that it can compile first, which takes longer than the kernels; machine
        code needs its allocator alone, and who compiles loads the rest then.
        """
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            if not _READ_ONLY:
                raise not_kept(error, _FOLDER) from None
        finally:
            self._release()

    def _release(self) -> None:
        if self._claim is not None:
            self._claim.close()
            self._claim = None


def _compiled(function: _Kernel, **options: Any) -> _Kernel:
    """Compile `function` in nopython mode and keep its machine code."""
    kernel = numba.njit(error_model="numpy", no_cfunc_wrapper=True, **options)(function)  # type: ignore[call-overload]
    kernel._cache = _KernelCache(function)  # as cache=True does
    return cast("_Kernel", kernel)


def jit(function: _Kernel) -> _Kernel:
    """Compile `function` in nopython mode; divisions by zero give inf or nan, as in IEEE 754."""
    return _compiled(function, nogil=True)


def jit_sums(function: _Kernel) -> _Kernel:
    """Compile `function` as `jit` does, but let its sums be added up in any order.

    So that they are added up many at a time; the last bits then depend on the processor.
    """
    return _compiled(function, nogil=True, fastmath={"reassoc", "contract"})


def jit_holding_gil(function: _Kernel) -> _Kernel:
    """Compile `function` as `jit` does, but let it keep the interpreter's lock.

    For what the loop calls: it takes microseconds, and a lock that is let go may come back only
    milliseconds later, if another thread of the process wants it.
    """
    return _compiled(function)


def constants(kind: type[Enum]) -> Any:
    """Return the members of an enum of whole numbers as a named tuple, which kernels compile in."""
    make: Any = namedtuple
    values = {name: int(member.value) for name, member in kind.__members__.items()}
    return make(kind.__name__, values)(**values)


class ArgumentBlock:
    """Arguments of a compiled function that stay the same from call to call.

    To check and unwrap an array costs a call about 0.2 us, an integer 0.02 us. So a function that
    is called in every tick is handed `address`, where it finds those of `arrays` (`records_at`).
    The arrays must be contiguous; they live as long as the frame.
    """

    def __init__(self, *arrays: np.ndarray) -> None:
        self._arrays = list(arrays)
        self._addresses = np.array([_address(array) for array in arrays], np.int64)
        self.address: int = self._addresses.ctypes.data

    def replace(self, place: int, array: np.ndarray) -> None:
        """Put another array of the same dtype and size in the place of one."""
        before = self._arrays[place]
        if (array.dtype, array.shape) != (before.dtype, before.shape):
            raise ValueError(
                f"argument {place} is {before.dtype} {before.shape}, "
                f"not {array.dtype} {array.shape}"
            )
        self._addresses[place] = _address(array)
        self._arrays[place] = array


def _address(array: np.ndarray) -> int:
    if not array.flags.c_contiguous or not array.flags.aligned:
        raise ValueError("an array that is handed over by its address must be contiguous")
    return int(array.ctypes.data)


@intrinsic
def _compiled_pointer(_context: Any, _address: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(numba.types.voidptr))

    return numba.types.voidptr(numba.types.int64), generate


_pointer: Any = ctypes.c_void_p if numba.config.DISABLE_JIT else _compiled_pointer  # type: ignore[attr-defined]
_carray: Any = numba.carray  # type: ignore[attr-defined]


@jit
def records_at(frame_address: int, place: int, count: int, dtype: "np.dtype[Any]") -> np.ndarray:
    """Return array `place` of an ArgumentBlock, as one of `count` elements of `dtype`."""
    addresses = _carray(_pointer(frame_address), (place + 1,), np.int64)
    records: np.ndarray = _carray(_pointer(int(addresses[place])), (count,), dtype)
    return records
