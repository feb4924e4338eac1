"""The errors of this package, and the package that it needs."""

from types import ModuleType


class BatchError(Exception):
    """Many recordings cannot be analysed, or no further; the message says why and what to do."""


class WorkerDiedError(Exception):
    """The workers that had a chunk died, as many in turn as the scheduler allows."""


def distributed() -> ModuleType:
    """Return Dask's distributed. Raises BatchError where it is not installed."""
    try:
        import distributed as found
    except ImportError as error:
        raise BatchError(
            f"many recordings are analysed by the package distributed ({error}): "
            "pip install 'motord[cluster]'"
        ) from error
    module: ModuleType = found
    return module
