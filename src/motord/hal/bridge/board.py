"""The bridge board, over whatever link: encoder and torque in, heartbeat and enable request out.

Samples flow from the first read on: what comes while nobody reads overflows somewhere on the way,
and nobody can know how much of what is older than the gap is still to come. In the loop a tick
costs one read and one write of the link. A board that starts anew while the loop runs is configured
again without waiting for its answers, and asked to close the line only once its Status states rate
and heartbeat timeout as they were set, and the loop has commanded an open line since. Nothing of it
counts before it has acknowledged a heartbeat that was sent since its Hello: what comes until then
may be late, or repeated by something on the way, and has no age that is known. One that does
not, that sends no samples any more, or receives no heartbeats, is sent a HelloRequest now and then:
it may have started anew while the link was down, or have missed so many heartbeats that it takes
the next for old ones. So is one that another host has barred: this host's HelloRequest ends that.
Its Hello says from which number heartbeats go on. Behind a port that was away may be another board:
nothing that it sends counts until its Hello says that it is the same. Nor does anything after the
Hello of another one, until the own one alone answers (`bridge.identity`); where only the other one
does, `refused` says who, for the loop to end with.
"""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from motord.config import Config
from motord.hal.base import DeviceError
from motord.hal.bridge.clock import BoardClock
from motord.hal.bridge.identity import BoardIdentity, refusal
from motord.hal.bridge.link import BridgeLink
from motord.hal.bridge.session import BoardSession
from motord.hal.countdown import Countdown, countdown_s
from motord.hal.loop_clock import LoopClock
from motord.schema import INT32_MAX, BridgeStatus
from motord.wire.bridge import frames

_REPEAT_S = 0.1
SILENCE_NS = 500_000_000
"""After this time without a sample, or with heartbeats that the board does not receive, it is asked
who it is, and again each time it is over; not before its samples are stale: it starts anew then."""
STATUS_NS = 100_000_000
"""So much older than its newest sample may be what a board acknowledges: two periods of Status. Of
one that is silent the samples are stale first, and that is what trips."""
_ENABLE_LINE = int(BridgeStatus.ENABLE_LINE)
_HEARTBEAT_LOST = int(BridgeStatus.HEARTBEAT_LOST)
_OTHER_BOARD = int(BridgeStatus.OTHER_BOARD)
_DEAF = int(BridgeStatus.HEARTBEAT_LOST | BridgeStatus.BARRED)
"""Of a board that heartbeats do not reach, or do not move."""
_UNIDENTIFIED = -1
_AHEAD = frames.HEARTBEAT_NUMBERS // 2

_Response = TypeVar("_Response", frames.Hello, frames.Status, frames.Sample)


class Bridge:
    """A `BridgeDriver`; `restarts` counts resets, `clock` is what is known of the board's clock."""

    def __init__(
        self, config: Config, name: str, hint: str, open_link: Callable[[], BridgeLink]
    ) -> None:
        """Take rates and scales from `config`; nothing is opened.

        `name` is whom errors name, `hint` what they add if something else is received, and
        `open_link` opens the link or raises DeviceError.
        """
        bridge = config.bridge
        self._name = name
        self._hint = hint
        self._open_link = open_link
        self.restarts = 0
        self._config = bridge
        self._counts = config.motor.counts
        self._configuration = frames.Configure(
            config.sample_rate_Hz, round(bridge.heartbeat_timeout_s * 1e6)
        )
        self._torque_Nm_per_count = config.torque_Nm_per_count
        self._link: BridgeLink | None = None
        self._openings = 0  # of the link, when the board last said who it is
        self._loop_clock = LoopClock()
        self.clock = BoardClock()
        self._number = 0  # of the next frame; its sequence is the rest of it
        self._lost_by_board = 0
        self._errors_before: int | None = None  # link errors count from the first read
        self._t_ns = 0
        self._silence_ns = max(SILENCE_NS, round(bridge.stale_after_s * 1e9))
        self._unacknowledged_ns = max(SILENCE_NS, round(bridge.stale_after_s * 1e9) + STATUS_NS)
        self._identity = BoardIdentity(self._counts, self._silence_ns)
        self._session = BoardSession(self._configuration, self.clock, opening=True)
        self._received_ns = 0  # newest sample's arrival, while the board receives heartbeats
        self._requested_ns = 0
        self._acknowledged_ns = 0  # when the newest heartbeat that the board has stated was sent
        self._sample = frames.Sample(0, 0, 0, 0)

    @property
    def refused(self) -> str:
        """Which other board alone has answered for some seconds, and what to do; "" if none."""
        wrong = self._identity.replaced(self._loop_clock.now_ns())
        return f"{self._name}: {wrong}; then `motord reset`" if wrong else ""

    def open(self) -> None:
        """Open the link, check the board and that it samples, all within `connect_timeout_s`.

        Raises DeviceError.
        """
        self._link = self._open_link()
        self._identity = BoardIdentity(self._counts, self._silence_ns)
        left = Countdown(self._config.connect_timeout_s)
        try:
            hello = self._request(frames.HelloRequest(frames.PROTOCOL), frames.Hello, left)
            self._begin_session(opening=True)
            self._number = hello.heartbeat_next
            self._update_from_status(self._request(self._configuration, frames.Status, left))
            self._sample = self._request(frames.Start(), frames.Sample, left)
            self._send(frames.Stop())
        except BaseException:
            self._link.close()
            self._link = None
            raise
        self._t_ns = self._loop_clock.now_ns()
        self._errors_before = None

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill t_ns, encoder_gray, torque_Nm, bridge_status; add link_errors."""
        clock = self._loop_clock
        clock.observe(now_ns)
        if self._link is not None:
            if self._errors_before is None:
                self._send(frames.Start())
                self._received_ns = now_ns  # its silence since it was opened is no reason to ask it
                self._acknowledged_ns = now_ns
            received = self._link.receive()
            if self._link.openings != self._openings:
                self._session.configured = False
                received = [numbered for numbered in received if type(numbered[1]) is frames.Hello]
            if received:
                stamp_ns = self._link.stamp_ns
                arrival_ns = clock.from_system(stamp_ns) if stamp_ns else clock.now_ns()
                self._process(received, now_ns, arrival_ns)
            if now_ns - max(self._received_ns, self._requested_ns) > self._silence_ns:
                self._requested_ns = now_ns
                self._send(frames.HelloRequest(frames.PROTOCOL))
        sample = self._sample
        feedback["t_ns"] = self._t_ns
        feedback["encoder_gray"] = sample.encoder_gray
        feedback["torque_Nm"] = sample.torque_counts * self._torque_Nm_per_count
        session, status = self._session, sample.status
        lost = now_ns - self._acknowledged_ns > self._unacknowledged_ns
        if lost or not session.configured or not session.may_close:
            status = self._unconfirmed(status, lost)
        feedback["bridge_status"] = status
        feedback["link_errors"] += self._link_errors()

    def _unconfirmed(self, status: int, lost: bool) -> int:
        """Return a status word without ENABLE_LINE: a board that is asked for an open line, or has
        acknowledged no heartbeat of late, cannot be who says that it is closed.

        In the second case HEARTBEAT_LOST is set: a board that never had one has lost none by its
        own status, and keeps the line open.
        """
        bits = (_HEARTBEAT_LOST if lost else 0) | (_OTHER_BOARD if self._identity.foreign else 0)
        return status & ~_ENABLE_LINE | bits

    def _link_errors(self) -> int:
        """Return the errors since the first read; no more than two links can add up."""
        errors = self._lost_by_board + (self._link.errors if self._link is not None else 0)
        if self._errors_before is None:
            self._errors_before = errors
        return min(errors - self._errors_before, INT32_MAX)

    def write(self, command: np.ndarray) -> None:
        """Send heartbeat and enable-line request.

        To a board that started anew nothing is asked for that was commanded before: for it this
        host would be one that knows of the open line, and it would close it again at once.
        """
        enable, session = bool(command["enable"][0]), self._session
        session.may_close = session.may_close or not enable
        self._send_heartbeat(1 if enable and session.configured and session.may_close else 0)

    def safe_stop(self) -> None:
        """Open the enable line; said twice, in case a frame is lost."""
        self._send_heartbeat(0)
        self._send_heartbeat(0)

    def close(self) -> None:
        """Open the enable line, stop the samples, release the link; may be called twice."""
        if self._link is None:
            return
        self.safe_stop()
        self._send(frames.Stop())
        self._link.close()
        self._link = None

    def _process(self, received: list[frames.Numbered], now_ns: int, arrival_ns: int) -> None:
        """Process what arrived: the newest sample counts, every heartbeat's echo."""
        newest, taken = None, True
        for _, frame in received:
            if type(frame) is frames.Sample:
                newest = frame if self._session.answered else None
            elif type(frame) is frames.Status and taken:
                self._update_from_status(frame)
            elif type(frame) is frames.Hello:
                newest, taken = None, self._identity.taken(frame, now_ns)
                if taken:
                    self._restart(frame)
                else:
                    self._openings, self._session.configured = _UNIDENTIFIED, False
        if newest is not None and taken and not self.clock.is_old(newest.t_us):
            if self._session.configured and not newest.status & _DEAF:
                self._received_ns = arrival_ns
            self._sample = newest
            self._t_ns = self.clock.received(newest.t_us, arrival_ns)

    def _update_from_status(self, status: frames.Status) -> None:
        self._acknowledged_ns = self._session.acknowledged_ns(status) or self._acknowledged_ns
        if self._session.answered:
            self._lost_by_board += self._session.update(status)

    def _begin_session(self, *, opening: bool) -> None:
        assert self._link is not None
        self._openings = self._link.openings
        self._session = BoardSession(self._configuration, self.clock, opening=opening)

    def _restart(self, hello: frames.Hello) -> None:
        """Configure and start a board that was reset, or cut off, while the loop runs.

        The answers acknowledge the heartbeat that is sent first: so a round trip later it counts.
        """
        self.restarts += 1
        if (hello.heartbeat_next - self._number) % frames.HEARTBEAT_NUMBERS < _AHEAD:
            self._number = hello.heartbeat_next
        self._begin_session(opening=False)
        self._send_heartbeat(0)
        self._send(self._configuration)
        self._send(frames.Start())

    def _send_heartbeat(self, enable: int) -> None:
        number = self._number % frames.SEQUENCE_MODULUS
        self._session.sent(number, self._loop_clock.now_ns())
        self._send(frames.Heartbeat.of(self._number, enable=enable == 1))

    def _send(self, frame: frames.Frame) -> None:
        number = self._number
        self._number = (number + 1) % frames.HEARTBEAT_NUMBERS
        if self._link is not None:
            self._link.send(frame, number % frames.SEQUENCE_MODULUS)

    def _request(
        self, request: frames.Frame, response: type[_Response], left: Countdown
    ) -> _Response:
        """Send `request` until a `response` comes that does not refuse it; once if no time is left.

        A Status may be older than the request: a board that streamed before sends them unasked.
        Raises DeviceError if none comes, or the Hello of a board that cannot be used, or a second.
        """
        link = self._link
        assert link is not None
        refused: str | None = None
        while True:
            self._send(request)
            for left_s in countdown_s(_REPEAT_S):
                link.wait(left_s)
                received = [frame for _, frame in link.receive()]
                for found in received:
                    if isinstance(found, frames.Hello) and (wrong := self._identity.wrong(found)):
                        raise self._error(wrong)
                for found in received:
                    if isinstance(found, response):
                        if isinstance(found, frames.Status):
                            refused = refusal(found, self._configuration)
                        if refused is None:
                            return found
            try:
                left.left_s()
            except TimeoutError:
                raise self._error(refused or self._silence(response)) from None

    def _silence(self, response: type[frames.Frame]) -> str:
        """Return what is wrong with a link on which no `response` came."""
        assert self._link is not None
        what = f"no {response.__name__} within {self._config.connect_timeout_s:g} s, "
        if opened := self._identity.opened:
            return f"{what}although {opened.board_name} has said who it is; reset the board"
        if received := self._link.received:
            return f"{what}{received}; {self._hint}"
        return f"{what}nothing at all; is the board powered, and is this where it is?"

    def _error(self, what: str) -> DeviceError:
        return DeviceError(f"{self._name}: {what}")
