"""The one exception of the client."""


class ClientError(Exception):
    """The daemon cannot be reached or refuses a request, or a reply is not of its form.

    `code` is the daemon's own, or "unreachable", "forbidden", "unknown", "busy" or "bad_answer".
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
