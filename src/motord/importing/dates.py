"""Dates in a form of their own, also without a day or a year."""

import re
from datetime import UTC, datetime

MIDNIGHT = datetime(1900, 1, 1, tzinfo=UTC)
"""What a time of day counts from, and a day without a year."""

WITH_YEAR = frozenset("YyGcx")
"""Directives of `strptime` from which the year follows."""

OF_A_DAY = frozenset("HIMSfpzZX%")
"""Directives of a time of day."""


def is_time_of_day(date_format: str) -> bool:
    """Return whether a format of `strptime` has no part of a day."""
    return OF_A_DAY.issuperset(re.findall("%(.)", date_format))


def date_of(cell: str, date_format: str) -> datetime:
    """Return the date that a cell has by a format of `strptime`, in 1900 if that has no year.

    Said so to `strptime`, whose own default for a day without a year ends with Python 3.15. Raises
    ValueError for a cell that is no such date, re.error for a format with a part twice.
    """
    if WITH_YEAR.isdisjoint(re.findall("%(.)", date_format)):
        cell, date_format = f"{MIDNIGHT.year}|{cell}", f"%Y|{date_format}"
    return datetime.strptime(cell, date_format)
