"""What goes wrong between a client and the daemon."""


class ClientError(Exception):
    """The daemon cannot be reached or refuses. `code` is its own, "unreachable" or "forbidden"."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
