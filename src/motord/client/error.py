"""What goes wrong between a client and the daemon."""


class ClientError(Exception):
    """The daemon cannot be reached or refuses, or what came is not from it.

    `code` is the daemon's own, or "unreachable", "forbidden", "unknown", "busy" or "bad_answer".
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
