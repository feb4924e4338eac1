"""How punctual the loop is on a machine, measured in alternation with cyclictest."""


class LatencyError(Exception):
    """A measurement that cannot be made; the message says why and what to do."""
