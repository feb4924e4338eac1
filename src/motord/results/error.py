"""What a results store cannot do, and the packages that it needs."""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType


class ResultsError(Exception):
    """A store or a question that cannot be used; the message says which, why and what to do."""


def parquet() -> ModuleType:
    """Return pyarrow.parquet. Raises ResultsError where it is not installed."""
    _loaded("pyarrow")
    return _loaded("pyarrow.parquet")


def require_parquet() -> None:
    """Raise ResultsError where pyarrow is not installed; it is not imported, which takes 0.3 s."""
    if find_spec("pyarrow") is None:
        raise _missing("pyarrow")


def duckdb() -> ModuleType:
    """Return duckdb. Raises ResultsError where it is not installed."""
    return _loaded("duckdb")


def fsspec() -> ModuleType:
    """Return fsspec. Raises ResultsError where it is not installed."""
    return _loaded("fsspec", "a results store at a URL", "remote")


def _loaded(name: str, what: str = "the results store", extra: str = "results") -> ModuleType:
    try:
        return import_module(name)
    except ImportError as error:
        raise _missing(name.partition(".")[0], what, extra) from error


def _missing(package: str, what: str = "the results store", extra: str = "results") -> ResultsError:
    return ResultsError(f"{what} needs the package {package}: pip install 'motord[{extra}]'")
