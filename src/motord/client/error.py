"""The exceptions of the client."""

from motord.api.plan_messages import PlanView


class ClientError(Exception):
    """The daemon cannot be reached or refuses a request, or a reply is not of its form.

    `code` is the daemon's own, or "unreachable", "forbidden", "unknown", "busy" or "bad_answer".

    >>> try:
    ...     client.rpc("enable", token="of somebody else")
    ... except ClientError as error:
    ...     print(error.code)
    no_lease
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


class PlanEndedError(ClientError):
    """A plan ended before it was done: `progress` is its last, `code` its state.

    "aborted": by somebody, or with the lease; "failed": the bench tripped or did not come to an
    operating point; "interrupted": the daemon ended meanwhile. It can be resumed in each case.
    """

    def __init__(self, progress: PlanView) -> None:
        message = f": {progress.message}" if progress.message else ""
        super().__init__(progress.state, f"{progress.plan} {progress.state}{message}")
        self.progress = progress
