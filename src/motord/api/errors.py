"""What a request is answered with when it is not carried out."""

from typing import Literal

Code = Literal[
    "invalid",  # the request itself: a field missing, unknown, of the wrong type or not finite
    "no_lease",  # the token is wrong, has expired or was taken over
    "lease_held",  # somebody else is in command
    "plan_running",  # a plan sets torque and speed now
    "refused",  # not possible in this state; the message says why and what to do
    "tripped",  # the drive tripped instead
    "timeout",  # what was asked for did not happen in time
    "failed",  # a file or a device could not be used
    "busy",  # the daemon did not come to it in time
    "internal",  # the program erred; the bench was stopped, the traceback is in the daemon's log
]


class RpcError(Exception):
    """A request that is refused: `code` for programs, the message for people."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.code: Code = code
        self.message = message

    def __reduce__(self) -> tuple[type["RpcError"], tuple[Code, str]]:
        """Let it pass from one process to another."""
        return type(self), (self.code, self.message)
