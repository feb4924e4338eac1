"""Whether there is a loop, and whether it lives."""

from motord.api.descriptions import ENDED_REMEDY, HANGING_REMEDY, LOOP_STUCK
from motord.config.timing import CONNECT_MAX_S
from motord.kernel_cache import COMPILING_S

STALLED_NS = 1_000_000_000
"""A loop that publishes nothing for this long is reported, and a plan ends."""
STARTING_NS = round((COMPILING_S + 2 * CONNECT_MAX_S) * 1e9)
"""A loop that is not up by then is reported as one that hangs: the longest waits for its kernel and
for a first answer of inverter and board are over. One that comes up later is well."""
LOOP_STARTS = "the loop is not up yet"


class LoopHealth:
    """From the start of a loop over its ticks to its end. Times are monotonic ns.

    `fault`: why no loop is up, "" if one is; `stalled`: its process runs and publishes no ticks, or
    does not come up.
    """

    def __init__(self) -> None:
        self.fault = LOOP_STARTS
        self.starting = True
        self.stalled = False
        self._without_ns = 0  # newest look at which no loop was up
        self._not_starting_ns: int | None = None  # newest look at which none was starting

    @property
    def remedy(self) -> str:
        """What to do about a loop that hangs or has ended; "" about one that runs or starts."""
        if self.starting:
            return ""
        if self.stalled:
            return HANGING_REMEDY
        return ENDED_REMEDY if self.fault else ""

    def starts(self) -> None:
        """A loop was started and is not up yet."""
        self.fault, self.starting = LOOP_STARTS, True

    def up(self) -> None:
        """A loop runs, OFF."""
        self.fault, self.starting = "", False

    def ended(self, why: str) -> None:
        """The loop has ended."""
        self.fault, self.starting, self.stalled = why, False, False

    def watch(self, now_ns: int, read_ns: int) -> str:
        """Return what has gone wrong by now, once; `read_ns` is when the newest tick was read."""
        if self._not_starting_ns is None or not self.starting:
            self._not_starting_ns = now_ns
        if self.fault:
            return self._watch_start(now_ns, self._not_starting_ns)
        before = self.stalled
        self.stalled = now_ns - max(read_ns, self._without_ns) > STALLED_NS
        if not self.stalled or before:
            return ""
        return f"the loop has published no tick for {STALLED_NS / 1e9:g} s"

    def _watch_start(self, now_ns: int, not_starting_ns: int) -> str:
        self._without_ns = now_ns
        if now_ns - not_starting_ns > STARTING_NS:
            self.fault, self.starting, self.stalled = LOOP_STUCK, False, True
            return LOOP_STUCK
        return ""
