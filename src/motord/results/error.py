"""What a results store cannot do, and the packages that it needs."""

from importlib.util import find_spec
from types import ModuleType


class ResultsError(Exception):
    """A store or a question that cannot be used; the message says which, why and what to do."""


def parquet() -> ModuleType:
    """Return pyarrow.parquet. Raises ResultsError where it is not installed."""
    try:
        from pyarrow import parquet
    except ImportError as error:
        raise _missing("pyarrow") from error
    found: ModuleType = parquet
    return found


def require_parquet() -> None:
    """Raise ResultsError where pyarrow is not installed; it is not imported, which takes 0.3 s."""
    if find_spec("pyarrow") is None:
        raise _missing("pyarrow")


def duckdb() -> ModuleType:
    """Return duckdb. Raises ResultsError where it is not installed."""
    try:
        import duckdb
    except ImportError as error:
        raise _missing("duckdb") from error
    return duckdb


def fsspec() -> ModuleType:
    """Return fsspec. Raises ResultsError where it is not installed."""
    try:
        import fsspec
    except ImportError as error:
        raise ResultsError(
            "a results store at a URL needs the package fsspec: pip install 'motord[remote]'"
        ) from error
    found: ModuleType = fsspec
    return found


def _missing(package: str) -> ResultsError:
    return ResultsError(
        f"the results store needs the package {package}: pip install 'motord[results]'"
    )
