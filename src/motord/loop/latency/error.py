"""What can go wrong in measuring latencies."""


class LatencyError(Exception):
    """A measurement that cannot be made; the message says why and what to do."""
