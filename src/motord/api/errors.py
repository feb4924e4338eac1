"""Errors of the RPCs: the codes, and the exception that a refused request raises."""

import json
from typing import Literal

Code = Literal[
    "invalid",  # the request itself: a field missing, unknown, of the wrong type or not finite
    "no_lease",  # the token is wrong, has expired or was taken over
    "lease_held",  # somebody else holds the lease
    "plan_running",  # a plan sets torque and speed now
    "refused",  # not possible in this state; the message says why and what to do
    "tripped",  # the drive tripped instead
    "timeout",  # the condition did not come about in time
    "failed",  # a file or a device could not be used
    "busy",  # too many requests, or no reply in time
    "internal",  # an error in the program; the bench was stopped, the traceback is in the log
]


MESSAGE_CHARACTERS = 4096
"""The longest message of an error reply; of a longer one the beginning is sent."""


class RpcError(Exception):
    """A request that is refused: `code` for programs, the message for people."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.code: Code = code
        self.message = message

    def __reduce__(self) -> tuple[type["RpcError"], tuple[Code, str]]:
        """Pickle by code and message: a calibration is read in another process."""
        return type(self), (self.code, self.message)

    def to_json(self) -> bytes:
        """Return the body of an error reply."""
        message = self.message
        if len(message) > MESSAGE_CHARACTERS:
            message = message[: MESSAGE_CHARACTERS - 3] + "..."
        return json.dumps({"code": self.code, "message": message}).encode()
