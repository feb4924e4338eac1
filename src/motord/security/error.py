"""What goes wrong with the files of access."""


class SecurityError(Exception):
    """A file of access that is missing or wrong; the message says which and what to do."""
