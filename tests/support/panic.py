"""What a panic of a library in Rust looks like: an error that is no Exception."""


class PanicError(BaseException):
    """As PyO3 raises it."""


def panic(*_args: object, **_more: object) -> None:
    """Raise it, whatever is asked."""
    raise PanicError("of a library in Rust")
