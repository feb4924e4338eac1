"""Whether a bridge board can be used, by what it says of itself; texts go on after its name."""

from motord.wire.bridge import frames

_FOREIGN_HOLD = 3
_FOREIGN_LASTS = 6
"""In times of silence, after each of which a board whose samples do not count is asked who it is:
two answers of either may be lost, and a trip's black box is whole before the loop ends."""


class BoardIdentity:
    """Which board is taken: the one that was opened, and none while another one answers.

    On CAN two boards may have one identifier; nothing tells whose samples came. So after the Hello
    of another board the own one is taken again only with a Hello that comes when no other has for
    `_FOREIGN_HOLD` times the silence: of two boards that both answer, none is.
    """

    def __init__(self, counts: int, silence_ns: int) -> None:
        """`counts`: of the motor's encoder; `silence_ns`: until a board is asked who it is."""
        self._counts = counts
        self._hold_ns = _FOREIGN_HOLD * silence_ns
        self._lasts_ns = _FOREIGN_LASTS * silence_ns
        self.opened: frames.Hello | None = None
        self._wrong = ""  # with the other board; "" while the own one is taken
        self._other_ns = 0  # newest Hello of another board
        self._own_ns = 0  # newest Hello of the own one, or the first of another one

    @property
    def foreign(self) -> bool:
        """Whether another board has answered, and the own one is not taken again."""
        return self._wrong != ""

    def wrong(self, hello: frames.Hello) -> str:
        """Return what is wrong with a board while it is opened; "" if nothing is.

        The first one is taken for the own; from then on it is wrong that another one answers.
        """
        wrong = incompatibility(hello, self._counts, self.opened)
        if wrong is None:
            self.opened = hello
        return wrong or ""

    def taken(self, hello: frames.Hello, now_ns: int) -> bool:
        """Return whether a Hello in mid-run is the own board's, and no other one is about."""
        wrong = incompatibility(hello, self._counts, self.opened)
        if wrong:
            self._own_ns = self._own_ns if self._wrong else now_ns
            self._other_ns, self._wrong = now_ns, wrong
            return False
        self._own_ns = now_ns
        if self._wrong and now_ns - self._other_ns <= self._hold_ns:
            return False
        self._wrong = ""
        return True

    def replaced(self, now_ns: int) -> str:
        """Return which other board alone has answered for `_FOREIGN_LASTS` times the silence."""
        alone = now_ns - self._own_ns >= self._lasts_ns
        return self._wrong if alone and now_ns - self._other_ns <= self._hold_ns else ""


def refusal(status: frames.Status, wanted: frames.Configure) -> str | None:
    """Return why a board does not do as it was configured, by its Status; None if it does."""
    if (status.rate_Hz, status.heartbeat_timeout_us) == wanted:
        return None
    return (
        f"the board cannot sample at {wanted.rate_Hz} Hz with a heartbeat timeout of "
        f"{wanted.heartbeat_timeout_us} us, it stays at {status.rate_Hz} Hz and "
        f"{status.heartbeat_timeout_us} us; set rate_Hz in [bridge], or heartbeat_timeout_s"
    )


def incompatibility(hello: frames.Hello, counts: int, opened: frames.Hello | None) -> str | None:
    """Return which board cannot be used, and why; None if it can.

    `counts`: of the motor's encoder; `opened`: Hello of the board that was opened, None before.
    """
    why = _difference(hello, counts, opened)
    return why and f"{hello.board_name} (firmware {hello.firmware_version}) {why}"


def _difference(hello: frames.Hello, counts: int, opened: frames.Hello | None) -> str | None:
    if hello.protocol != frames.PROTOCOL:
        return (
            f"speaks protocol {hello.protocol}, motord speaks {frames.PROTOCOL}; "
            "update the older of the two"
        )
    if hello.layout != frames.LAYOUT_HASH:
        return (
            "was built with other frame layouts than this motord "
            f"({hello.layout:08x}, here {frames.LAYOUT_HASH:08x}); update the older of the two"
        )
    if opened is not None and hello.serial != opened.serial:
        return (
            f"has serial number {hello.serial}, but the board that was opened has {opened.serial}; "
            "connect that one, or leave this one to be taken"
        )
    if hello.counts not in (0, counts):
        return (
            f"has an encoder of {hello.counts} counts, "
            f"the bench file says [motor] counts = {counts}"
        )
    return None
