"""The errors of this package."""


class ArchiveError(Exception):
    """Nothing more can be archived for now; the message says why and what to do."""


class ConflictError(ArchiveError):
    """One recording that cannot be archived: there is another file of its name, or it changes."""


class PausedError(ArchiveError):
    """The bench is needed; what is copied so far stays, and the next run goes on from there."""
