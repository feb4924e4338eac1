"""Results that nobody measured."""

from datetime import UTC, datetime, timedelta

import numpy as np

from motord.results.figures import ResultFigure
from motord.results.store import ResultsStore
from motord.results.stored_result import ResultRow, StoredResult

BEGIN = datetime(2026, 3, 1, 8, tzinfo=UTC)


def figure(value=0.8, field="alpha.a", unit="", stderr=0.001):
    half = 2.0 * stderr if stderr is not None else None
    ends = (None, None) if half is None else (value - half, value + half)
    return ResultFigure(field, unit, value, stderr, *ends)


def result(number=0, values=(0.8,), **changes):
    """Return the calibration of recording `number`, a day after the one before it."""
    figures = [figure(value, f"alpha.{phase}") for value, phase in zip(values, "abc", strict=False)]
    known = {
        "experiment": "calibrate", "motor": "axial-flux 48/16", "serial": "A-1", "bench": "north",
        "run": f"run-{number:03d}.mcap", "time": BEGIN + timedelta(days=number), "version": "1.0",
        "settings": {"method": "joint"}, "figures": figures,
        "recordings": [(f"run-{number:03d}.mcap", f"{number:064x}")],
    }  # fmt: skip
    return StoredResult(**{**known, **changes})


def row(value=0.8, **changes):
    [one] = result(values=(value,)).rows()
    return ResultRow(**{**vars(one), **changes})


def fill(folder, values, **changes):
    """Store a result for each value, and return the store."""
    store = ResultsStore(folder)
    store.make()
    for number, value in enumerate(np.atleast_1d(values)):
        store.add(result(number, (float(value),), **changes))
    return store
