"""Whether a bridge board can be used, by what it says of itself; texts go on after its name."""

from motord.wire.bridge import frames


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
