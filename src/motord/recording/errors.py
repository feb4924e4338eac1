"""The error of this package."""


class RecordError(Exception):
    """A recording that cannot be read or written; the message says which, why and what to do."""
