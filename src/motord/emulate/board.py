"""What the emulated bridge board does, without I/O: frames in, frames out, heartbeat, own clock.

All times are monotonic nanoseconds, arguments; nothing here reads a clock.
"""

from motord.config import Config
from motord.emulate.devices import NEVER_NS
from motord.schema import FAULT_COUNT_MODULUS, FAULT_COUNT_SHIFT, BridgeStatus
from motord.wire.bridge import frames
from motord.wire.sequence import SequenceCheck

BOARD_NAME = b"motord-emulate"
FIRMWARE = frames.firmware(1, 3, 0)
CLOCK_OFFSET_US = 3_000_000_000
"""Reading of the board's clock at its reset: wraps its 32 bits after some 20 minutes."""
CLOCK_DRIFT = 35e-6
"""How much faster than the host's clock the board's clock runs."""
RATES_HZ = (100, 20_000)
TIMEOUTS_US = (1_000, 1_000_000)
"""What Configure may ask for; one of the two out of range, and neither is taken."""
RESET_RATE_HZ, RESET_TIMEOUT_US = 1000, 50_000
"""What holds from a reset to the first Configure."""
STATUS_PERIOD_NS = 50_000_000
_NOT_SAMPLED = int(BridgeStatus.ENCODER_INVALID | BridgeStatus.TORQUE_INVALID)


class Board:
    """The bridge board: samples from Start to Stop, holds the enable line closed as heartbeats ask.

    It does what `firmware_bridge` does (`tests/firmware/test_like_the_emulator.py`), but for the
    plausibility of the encoder's lines, which it never doubts.

    `heartbeat_timeout` without a heartbeat opens the line, as do Stop and a reset; it stays open
    until a heartbeat has asked for it to be open, so that a host that does not know of it does not
    find it closed again. A heartbeat whose number is not above every one since reset is an old one
    and none; so nothing that was sent before can keep the line closed, or close it. From a
    HelloRequest of another protocol until one of its own it is open whatever heartbeats ask.

    The link's decoder counts corrupt frames in `check` and passes all good ones.
    """

    def __init__(self, config: Config, reset_ns: int) -> None:
        self.heartbeat_drops = 0
        self.check = SequenceCheck(frames.SEQUENCE_MODULUS)
        self.faults_begun = 0
        self._counts = config.motor.counts
        Board.restart(self, reset_ns)  # not by the reset button that a subclass may have

    def restart(self, now_ns: int) -> None:
        """Start anew, as at a reset: nothing of what was before is known."""
        self.line_closed = self.streaming = False
        self.rate_Hz = RESET_RATE_HZ
        self.dropped = 0
        self.check.reset()
        self._timeout_ns = RESET_TIMEOUT_US * 1000
        self._reset_ns = self._status_ns = now_ns
        self._sample_status = _NOT_SAMPLED
        self._may_close = False  # a heartbeat with enable = 0 has come since reset, Stop, silence
        self._lost = self._barred = False
        self._heartbeat_ns = NEVER_NS
        self._heartbeats = self._heartbeat_sequence = self._heartbeat_t_us = 0
        self._heartbeat_next: int | None = None

    @property
    def errors(self) -> int:
        """Return the frames from the host that were lost, corrupt or old."""
        return self.check.errors

    @property
    def deadline_ns(self) -> int:
        """When the host has been silent for too long; NEVER_NS if that is of no matter."""
        return self._heartbeat_ns + self._timeout_ns if self._may_close else NEVER_NS

    def clock_us(self, now_ns: int) -> int:
        """Return what the board's clock says: its own offset and drift, wrapping at 32 bits."""
        run_us = (now_ns - self._reset_ns) * (1e-3 * (1 + CLOCK_DRIFT))
        return (CLOCK_OFFSET_US + int(run_us)) % frames.CLOCK_MODULUS_US

    def receive(self, now_ns: int, numbered: frames.Numbered) -> list[frames.Frame]:
        """Take a good frame; return the answers."""
        self.expire(now_ns)
        frame = numbered.frame
        if isinstance(frame, frames.Hello | frames.Sample | frames.Status):
            self.check.corrupt()  # a board's frame: an echo
            return []
        if not self._accept(numbered):
            self._apply_stale(frame)
            return []
        if isinstance(frame, frames.Heartbeat):
            self._take_heartbeat(now_ns, numbered.sequence, frame.enable)
            return []
        if isinstance(frame, frames.HelloRequest):
            self._barred = frame.protocol != frames.PROTOCOL
            if self._barred:
                self._lost = self._may_close = self.line_closed = False
            return [self.hello()]
        if isinstance(frame, frames.Configure):
            self._configure(frame)
        elif isinstance(frame, frames.Start):
            self.streaming = True
        else:
            self.streaming = False
            self._open()
        return [self.status(now_ns)]

    def expire(self, now_ns: int) -> None:
        """Let time pass: open the enable line if the last heartbeat is too old."""
        if now_ns < self.deadline_ns:
            return
        self.heartbeat_drops += self.line_closed
        self._lost = True
        self._may_close = self.line_closed = False

    def hello(self) -> frames.Hello:
        """Return who the board is."""
        return frames.Hello(
            protocol=frames.PROTOCOL,
            firmware=FIRMWARE,
            board=BOARD_NAME,
            serial=1,
            rate_Hz=self.rate_Hz,
            counts=self._counts,
            layout=frames.LAYOUT_HASH,
            heartbeat_next=self._heartbeat_next or 0,
        )

    def sample(
        self, now_ns: int, encoder_gray: int, torque_counts: int, torque_clipped: bool
    ) -> frames.Sample:
        """Return the sample of this instant."""
        self._sample_status = int(BridgeStatus.TORQUE_INVALID) if torque_clipped else 0
        return frames.Sample(
            self.clock_us(now_ns), encoder_gray, torque_counts, self._status_word()
        )

    def status_is_due(self, now_ns: int) -> bool:
        """Return whether a Status is to be sent unasked."""
        return self.streaming and now_ns - self._status_ns >= STATUS_PERIOD_NS

    def status(self, now_ns: int) -> frames.Status:
        """Return the board's account of itself, which is sent now."""
        self._status_ns = now_ns
        return frames.Status(
            t_us=self.clock_us(now_ns),
            status=self._status_word(),
            heartbeat_sequence=self._heartbeat_sequence,
            heartbeat_t_us=self._heartbeat_t_us,
            heartbeats=self._heartbeats,
            errors=self.errors,
            dropped=self.dropped,
            rate_Hz=self.rate_Hz,
            heartbeat_timeout_us=self._timeout_ns // 1000,
            streaming=int(self.streaming),
        )

    def jump(self, by_ns: int) -> None:
        """Let the board's clock jump."""
        self._reset_ns -= by_ns

    def _status_word(self) -> int:
        return (
            self._sample_status
            | (int(BridgeStatus.ENABLE_LINE) if self.line_closed else 0)
            | (int(BridgeStatus.HEARTBEAT_LOST) if self._lost else 0)
            | (int(BridgeStatus.BARRED) if self._barred else 0)
            | self.faults_begun % FAULT_COUNT_MODULUS << FAULT_COUNT_SHIFT
        )

    def _accept(self, numbered: frames.Numbered) -> bool:
        """Judge a frame's number: whether it is new.

        HelloRequest is a host that starts: the next frame begins a count. A heartbeat's number goes
        further than the frame's, and nothing but a reset lets it step back.
        """
        sequence, frame = numbered
        if isinstance(frame, frames.HelloRequest):
            self.check.restart()
            return True
        if not isinstance(frame, frames.Heartbeat):
            return self.check.accept(sequence, may_restart=False)
        number, numbers = frame.number(sequence), frames.HEARTBEAT_NUMBERS
        expected = number if self._heartbeat_next is None else self._heartbeat_next
        if (number - expected) % numbers >= numbers // 2:
            self.check.corrupt()
            return False
        self._heartbeat_next = (number + 1) % numbers
        return self.check.accept(sequence)

    def _apply_stale(self, frame: frames.Frame) -> None:
        """Open the line if an old frame asks for it: that does no harm."""
        asks = isinstance(frame, frames.Heartbeat) and not frame.enable and self.line_closed
        if asks or isinstance(frame, frames.Stop):
            self._open()

    def _take_heartbeat(self, now_ns: int, sequence: int, close_line: bool) -> None:
        self._heartbeats += 1
        self._heartbeat_sequence = sequence
        self._heartbeat_t_us = self.clock_us(now_ns)
        self._heartbeat_ns = now_ns
        if not close_line and not self._barred:
            self._may_close, self._lost = True, False
        self.line_closed = close_line and self._may_close

    def _configure(self, frame: frames.Configure) -> None:
        rate_Hz, timeout_us = frame.rate_Hz, frame.heartbeat_timeout_us
        rate_fits = RATES_HZ[0] <= rate_Hz <= RATES_HZ[1]
        if rate_fits and TIMEOUTS_US[0] <= timeout_us <= TIMEOUTS_US[1]:
            self._open()  # an old one cannot prolong the time of a host that fell silent
            self.rate_Hz = rate_Hz
            self._timeout_ns = timeout_us * 1000

    def _open(self) -> None:
        """Open the line until a heartbeat has asked for it to be open."""
        self._may_close = self.line_closed = False
