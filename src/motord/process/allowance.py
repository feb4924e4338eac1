"""A rate limit: a sustained rate and a burst."""


class Allowance:
    """A token bucket, filled by `rate_per_s` up to `burst`. Times are ns."""

    def __init__(self, rate_per_s: float, burst: float) -> None:
        self._rate_per_s = rate_per_s
        self._burst = burst
        self._left = burst
        self._at_ns: int | None = None

    def spend(self, amount: float, now_ns: int) -> bool:
        """Take `amount` and return True; False, and take nothing, if there is not so much."""
        passed_s = (now_ns - (self._at_ns if self._at_ns is not None else now_ns)) / 1e9
        self._at_ns = now_ns
        self._left = min(self._burst, self._left + passed_s * self._rate_per_s)
        if amount > self._left:
            return False
        self._left -= amount
        return True
