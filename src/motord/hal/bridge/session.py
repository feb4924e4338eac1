"""What is known of a bridge board since its Hello; each Hello begins a new session."""

from motord.hal.bridge.clock import BoardClock
from motord.hal.bridge.identity import refusal
from motord.wire.bridge import frames

_HEARTBEATS_KEPT = 1024  # power of two: their numbers index it


class BoardSession:
    """From one Hello of a board to its next: nothing of the session before is known to it.

    `answered`: it has acknowledged a heartbeat of this session, as no repeated session does; what
    comes before counts for nothing. `configured`: by its newest Status it does as it was
    configured. `may_close`: the command was an open line since the session began; what was
    commanded before is not asked of this board.
    """

    def __init__(
        self, configuration: frames.Configure, clock: BoardClock, *, opening: bool
    ) -> None:
        """Start the clock anew: what was learnt of the board's counter may not hold any more.

        `opening`: the board answered request by request, and nothing was commanded before.
        """
        clock.reset()
        self.configured = False
        self.answered = self.may_close = opening
        self._configuration = configuration
        self._clock = clock
        self._sent = [(-1, 0)] * _HEARTBEATS_KEPT  # number and time of each heartbeat
        self._heartbeats = 0  # received by the board, by its newest Status
        self._errors = -1  # as last reported, -1 if not yet

    def sent(self, number: int, t_ns: int) -> None:
        """Note when the heartbeat with this number was sent."""
        self._sent[number % _HEARTBEATS_KEPT] = (number, t_ns)

    def acknowledged_ns(self, status: frames.Status) -> int | None:
        """Return when the heartbeat was sent that `status` is the first to acknowledge, if one."""
        before, self._heartbeats = self._heartbeats, status.heartbeats
        number, sent_ns = self._sent[status.heartbeat_sequence % _HEARTBEATS_KEPT]
        if status.heartbeats in (0, before) or number != status.heartbeat_sequence:
            return None
        self.answered = True
        self._clock.heartbeat(status.heartbeat_t_us, sent_ns)
        return sent_ns

    def update(self, status: frames.Status) -> int:
        """Take whether the board does as it was configured; return the frames lost since before."""
        configured = refusal(status, self._configuration) is None
        if self.configured and not configured:
            self.may_close = False
        self.configured = configured
        errors = status.errors + status.dropped
        lost = max(errors - self._errors, 0) if self._errors >= 0 else 0
        self._errors = errors
        return lost
