"""Functions whose arrays are computed once, and read-only, as all callers share them."""

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar, cast

import numpy as np

P = ParamSpec("P")
R = TypeVar("R", bound=np.ndarray | tuple[np.ndarray, ...])


def cached_arrays(maxsize: int | None = None) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator as `functools.lru_cache`, of a function of an array or a tuple of them.

    To write into what the function returned raises ValueError.
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def frozen(*args: P.args, **kwargs: P.kwargs) -> R:
            made = function(*args, **kwargs)
            for array in made if isinstance(made, tuple) else (made,):
                array.setflags(write=False)
            return made

        return cast("Callable[P, R]", lru_cache(maxsize)(frozen))

    return decorated
