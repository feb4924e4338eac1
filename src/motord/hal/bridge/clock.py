"""Times of a board's samples: its counter mapped to the loop's clock, from two bounds.

A sample is read after it was taken, a heartbeat arrives after it was sent. Delays vary, their least
values hardly. The delay of samples includes the wait until the loop reads, which slides through a
whole period as the two rates slip past each other; so the drift comes from the heartbeats alone.
"""

from motord.config.timing import SAMPLE_TIME_S
from motord.hal.bridge.drift_estimator import HeartbeatLine, SampleBound
from motord.wire.bridge.frames import CLOCK_MODULUS_US

HEARTBEAT_LATENCY_NS = round(SAMPLE_TIME_S * 1e9)
"""Half the round trip is taken for the heartbeat's way, but never more than this: what else is in
the round trip is the time until the loop comes round to read."""
INCONSISTENT_NS = 20_000
"""A heartbeat received before it can have been sent by more than this was stamped wrongly."""
JITTER_WEIGHT = 1 / 256
"""Weight of each reading in the mean delay of samples and in their mean deviation from it."""
JUMP_NS = 50_000_000
LATE_NS = 1_000_000_000
"""A board's clock has jumped if its samples are ahead by more than JUMP_NS; or behind by more for
LATE_NS on end, while no heartbeat says otherwise."""


class BoardClock:
    """Maps a board's counter of microseconds, which wraps, to the loop's clock.

    Two-way: `received` for every reading of samples, `heartbeat` whenever the board reports when it
    received one. Without heartbeats a sample's time is late by the least delay until it is read. A
    counter that leaps ahead, or stays behind, starts the filter anew.
    `jitter_ns` is the mean deviation of the samples' delay until they are read from its mean.
    """

    def __init__(self) -> None:
        self.jitter_ns = 0.0
        self._delay_ns = 0.0
        self._ticks: int | None = None
        self._board_ns = 0
        self._sampled_ns = 0
        self._upper: SampleBound | None = None
        self._lower: HeartbeatLine | None = None
        self._late_since_ns: int | None = None

    @property
    def drift_ppm(self) -> float:
        """Return how much faster the board's clock runs than the loop's; 0 while not known."""
        return self._lower.drift * 1e6 if self._lower is not None else 0.0

    def reset(self) -> None:
        """Forget the board's clock: the board says that it has started anew."""
        self._ticks = None
        self._board_ns = 0
        self._upper = self._lower = None
        self._late_since_ns = None

    def is_old(self, ticks: int) -> bool:
        """Return whether a sample was taken before the newest: no counter steps back but a reset.

        Frames that are repeated after more than half a turn of their numbers have new ones. Half
        of the counter's range is behind, so of a board that ran for longer a reset looks ahead.
        """
        before = self._ticks
        return before is not None and (ticks - before) % CLOCK_MODULUS_US >= CLOCK_MODULUS_US // 2

    def received(self, ticks: int, arrival_ns: int) -> int:
        """Return the loop's time of a sample taken at `ticks` and read at `arrival_ns`.

        Feed the newest sample of each reading, unless it `is_old`. Never later than `arrival_ns`.
        Where the sample before turns out to have been read later than was thought, by less than two
        intervals between samples, this one is just after it; by more, the time goes back.
        """
        step_ns = 0
        if self._ticks is not None:
            step_ns = (ticks - self._ticks) % CLOCK_MODULUS_US * 1000
            self._board_ns += step_ns
            if self._jumped(arrival_ns):
                self.reset()
        self._ticks = ticks
        difference_ns = arrival_ns - self._board_ns
        if self._upper is None:
            self._upper = SampleBound(self._board_ns, difference_ns)
        else:
            self._upper.add(self._board_ns, difference_ns)
        sampled_ns = self._board_ns + self._difference_ns()
        if 0 <= self._sampled_ns - sampled_ns < step_ns:
            sampled_ns = self._sampled_ns + 1
        self._sampled_ns = sampled_ns = min(sampled_ns, arrival_ns)
        away_ns = arrival_ns - sampled_ns - self._delay_ns
        self._delay_ns += JITTER_WEIGHT * away_ns
        self.jitter_ns += JITTER_WEIGHT * (abs(away_ns) - self.jitter_ns)
        return sampled_ns

    def heartbeat(self, ticks: int, sent_ns: int) -> None:
        """Take that the board received at `ticks` what was sent at `sent_ns`.

        Ignored before the first sample, from where times are counted, and if it contradicts what
        the samples show: one wrong stamp would hold for as long as the bound remembers.
        """
        if self._ticks is None or self._upper is None:
            return
        half = CLOCK_MODULUS_US // 2
        step = (ticks - self._ticks + half) % CLOCK_MODULUS_US - half
        board_ns = self._board_ns + step * 1000
        value_ns = board_ns - sent_ns
        contradiction_ns = -value_ns - self._upper.at(board_ns)
        if contradiction_ns < JUMP_NS:
            self._late_since_ns = None  # the samples are late, the clock is not
        if contradiction_ns > INCONSISTENT_NS:
            return
        if self._lower is None:
            self._lower = HeartbeatLine(board_ns, value_ns)
        elif self._lower.add(board_ns, value_ns):
            self._upper.lean(-self._lower.drift)

    def _difference_ns(self) -> int:
        """Return loop's time minus board's time, at the board's newest sample."""
        assert self._upper is not None
        upper_ns = self._upper.at(self._board_ns)
        if self._lower is None:
            return upper_ns
        round_trip_ns = max(upper_ns + self._lower.at(self._board_ns), 0)
        return upper_ns - round_trip_ns + min(round_trip_ns // 2, HEARTBEAT_LATENCY_NS)

    def _jumped(self, arrival_ns: int) -> bool:
        """Return whether the board's clock is ahead, or behind for long, of what was learnt."""
        late_ns = arrival_ns - self._board_ns - self._difference_ns()
        if late_ns <= JUMP_NS:
            self._late_since_ns = None
            return late_ns < -JUMP_NS
        if self._late_since_ns is None:
            self._late_since_ns = arrival_ns
        return arrival_ns - self._late_since_ns > LATE_NS
