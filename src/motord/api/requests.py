"""The RPCs: name, request and reply of each, in one table; size limits and parsing of requests.

A request is a JSON object. Unknown fields, other types and numbers that are not finite are refused.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, StringConstraints, ValidationError, model_validator

from motord.api import queue_requests, replies
from motord.api.errors import RpcError
from motord.api.replies import RpcReply
from motord.api.request_base import Name
from motord.api.request_base import NoArguments as NoArguments
from motord.api.request_base import ReplyT as ReplyT
from motord.api.request_base import RequestT as RequestT
from motord.api.request_base import Rpc as Rpc
from motord.api.request_base import RpcRequest as RpcRequest
from motord.api.request_base import WithToken as WithToken
from motord.learned import MAX_NODES, MAX_ORDERS
from motord.schema import Compensation
from motord.section import matching
from motord.verdict.serial import check_serial


def _printable(text: str) -> str:
    """Return text. Raises ValueError unless all of it, in any language, can be printed."""
    if not text.isprintable():
        raise ValueError("only printable characters, in one line")
    return text


def one_line(text: str) -> str:
    """Return a text without what could pass for another line, or move a terminal's cursor."""
    return text if text.isprintable() else "".join(c if c.isprintable() else "?" for c in text)


NAME_MAX = 64
"""Characters of who asks for a stop."""


class LeaseAcquire(RpcRequest):
    """`lease/acquire`: who asks."""

    holder: Name
    """Who asks, for people: user, host, terminal."""
    force: bool = False
    """Take over from whoever is in command; it is an event."""


class StopNow(RpcRequest):
    """`stop`: from anyone, no token."""

    by: Annotated[str, AfterValidator(lambda name: one_line(name[:NAME_MAX]))] = ""
    """Who asks, for the log; a longer name is cut off, as no stop is refused for it."""


class Note(RpcRequest):
    """`note`: a remark for events and recording, from anyone who may command."""

    text: Annotated[
        str,
        StringConstraints(strip_whitespace=True, min_length=1, max_length=1000),
        AfterValidator(_printable),
    ]
    """The remark, of printable characters."""
    by: Annotated[
        str, StringConstraints(strip_whitespace=True, max_length=64), AfterValidator(_printable)
    ] = ""
    """Who made it."""


class SetpointChange(WithToken):
    """`set`: fields that are left out stay as they are."""

    enable: bool = False
    """Enable the bench first, if all of it can be done."""
    torque_Nm: float | None = None
    """Torque that the ramp goes to."""
    speed_Hz: float | None = None
    """The brake is servoed until the rotor turns at that speed, turns per second."""
    brake: Annotated[float, Field(ge=0, le=1)] | None = None
    """Excitation of the brake itself; ends the servo."""
    drive_Hz: float | None = None
    """Speed of the external drive, turns per second."""
    compensate: Compensation | None = None
    """Which parts of the calibration are applied; `calibration`: all but what was learned."""

    @model_validator(mode="after")
    def _something_to_set(self) -> "SetpointChange":
        given = self.model_fields_set - {"token", "enable"}
        if not given:
            raise ValueError("nothing to set: torque_Nm, speed_Hz, brake, drive_Hz, compensate")
        if self.speed_Hz is not None and self.brake is not None:
            raise ValueError("speed_Hz controls the brake and brake sets it: give one of them")
        return self


class PlanStart(RpcRequest):
    """`plan/start`: a plan by name; a dry run moves nothing and needs no token."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    """As `plan/list` names it."""
    token: Annotated[str, Field(max_length=128)] = ""
    """That of the lease in force; not for a dry run."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Changes to `[plans.<name>]`."""
    detach: bool = False
    """The plan goes on when the lease ends."""
    dry_run: bool = False
    """Check it against the limits, and move nothing."""
    notes: Annotated[str, Field(max_length=4000)] = ""
    """For the recording."""
    serial: Annotated[str, AfterValidator(check_serial)] = ""
    """The motor's serial number, for the recording; refused if the bench file names another."""
    check: bool = True
    """Check the calibration before, if `[calibration] check_before_plans` asks for it."""


class PlanResume(WithToken):
    """`plan/resume`: after a pause, or a plan that was interrupted."""

    detach: bool = False
    """The plan goes on when the lease ends; for one that was interrupted."""


class CalibrationInstall(WithToken):
    """`calibration/install`: the file's content, or its path as the daemon's host sees it."""

    calibration: dict[str, Any] | None = None
    """The file's content."""
    path: Annotated[str, Field(max_length=4096)] | None = None
    """The file, as the daemon's host sees it."""
    accept: Annotated[list[Name], Field(default_factory=list, max_length=32)]
    """Names of its serious findings; with one that is not named it is refused."""

    @model_validator(mode="after")
    def _one_source(self) -> "CalibrationInstall":
        if (self.calibration is None) == (self.path is None):
            raise ValueError("give either calibration (its content) or path")
        return self


NOTHING_DEPARTED = "nothing-departed"
"""What `calibration/adopt` accepts by name."""


class CalibrationAdopt(WithToken):
    """`calibration/adopt`."""

    accept: Annotated[list[Literal["nothing-departed"]], Field(default_factory=list, max_length=1)]
    """`nothing-departed`: that no quantity has departed that can be adopted; else it is refused."""


class CalibrationShow(RpcRequest):
    """`calibration/show`."""

    id: Annotated[
        str, Field(max_length=64), matching(r"[0-9a-f]*", "digits and letters from a to f")
    ] = ""
    """Which; "" is the one in force."""


LEASE_ACQUIRE = Rpc(
    "lease/acquire", LeaseAcquire, replies.LeaseGrant, "Take command, if nobody has it."
)
LEASE_RENEW = Rpc("lease/renew", WithToken, replies.LeaseTerms, "Stay in command.")
LEASE_RELEASE = Rpc(
    "lease/release", WithToken, RpcReply,
    "Give command up; a bench that is enabled ramps down and is disabled.",
)  # fmt: skip
ENABLE = Rpc(
    "enable", WithToken, replies.StateReply, "Enable at zero torque; replies once it is ENABLED."
)
DISABLE = Rpc(
    "disable", WithToken, replies.StateReply,
    "Ramp the torque to zero, then disable; ends a plan. Replies once the torque is zero.",
)  # fmt: skip
STOP = Rpc("stop", StopNow, replies.StateReply, "Zero current at once, and OFF; ends a plan.")
NOTE = Rpc("note", Note, replies.NoteReply, "Put a remark with its time into events and recording.")
RESET = Rpc(
    "reset", WithToken, replies.StateReply,
    "Leave TRIPPED if no cause is left; start the loop anew if it has ended or hangs.",
)  # fmt: skip
SET = Rpc(
    "set", SetpointChange, replies.SetpointReply,
    "Set what is named and leave the rest; with `enable`, replies once it is ENABLED.",
)  # fmt: skip
PLAN_START = Rpc(
    "plan/start", PlanStart, replies.PlanOutline, "Start a plan; a dry run moves nothing."
)
PLAN_PAUSE = Rpc("plan/pause", WithToken, replies.PlanProgress, "Ramp to zero and wait.")
PLAN_RESUME = Rpc(
    "plan/resume", PlanResume, replies.PlanProgress,
    "Go on after a pause, or with a plan that was interrupted.",
)  # fmt: skip
PLAN_ABORT = Rpc("plan/abort", WithToken, replies.PlanProgress, "Ramp down, disable, end the plan.")
PLAN_DISCARD = Rpc(
    "plan/discard", WithToken, replies.PlanName,
    "Forget the plan that was interrupted; its recordings stay.",
)  # fmt: skip
PLAN_LIST = Rpc("plan/list", NoArguments, replies.PlanList, "The plans, with their settings.")
CONFIG = Rpc("config", NoArguments, replies.ConfigReply, "The bench file.")
CALIBRATION_INSTALL = Rpc(
    "calibration/install", CalibrationInstall, replies.InstalledCalibration,
    "Put a calibration in force, now and after a restart; either of both fields.",
)  # fmt: skip
CALIBRATION_ADOPT = Rpc(
    "calibration/adopt", CalibrationAdopt, replies.InstalledCalibration,
    "Put the calibration in force as it is tracked, in place of the one in force.",
)  # fmt: skip
CALIBRATION_LIST = Rpc(
    "calibration/list", NoArguments, replies.CalibrationList,
    "The calibrations that the daemon keeps, the newest first.",
)  # fmt: skip
CALIBRATION_SHOW = Rpc(
    "calibration/show", CalibrationShow, replies.CalibrationDetails,
    "A calibration with its 95 % intervals.",
)  # fmt: skip

RPCS: dict[str, Rpc[Any, Any]] = {
    value.name: value
    for value in (*globals().values(), *vars(queue_requests).values())
    if isinstance(value, Rpc)
}
"""Every RPC above and of the queue, by its name."""

MAX_REQUEST_BYTES = 64 * 1024
"""Of every request but `calibration/install`."""
UNPROVEN_BYTES = 4096
"""A request that needs the lease and is longer is not even parsed without its token."""
NUMBER_BYTES = 32
"""A number in JSON with all its digits, sign, exponent, comma, line end and some indentation."""
TEXT_BYTES = 256 * 1024
"""All of a calibration that is not a table: harmonics, runs, errors by point, text."""
PASSES = 64
"""Passes of learning whose errors a calibration lists for each point."""
LEARNED_NUMBERS = MAX_NODES**2 * (4 * MAX_ORDERS + PASSES)
"""At most this many numbers have been learned: two by order, the best of them, the errors."""


def max_calibration_bytes(counts: int) -> int:
    """Return how long a calibration file may be for an encoder of `counts` counts."""
    return TEXT_BYTES + NUMBER_BYTES * (counts + LEARNED_NUMBERS)


def max_request_bytes(counts: int) -> int:
    """Return how long the longest request may be, which is an installation."""
    return MAX_REQUEST_BYTES + max_calibration_bytes(counts)


def check_size(name: str, size: int, limit: int = MAX_REQUEST_BYTES) -> None:
    """Raise RpcError "invalid" for a request of more than `limit` bytes."""
    if size > limit:
        raise RpcError("invalid", f"{name}: {size} bytes, more than the {limit} allowed")


def parse(rpc: Rpc[RequestT, ReplyT], payload: bytes, limit: int = MAX_REQUEST_BYTES) -> RequestT:
    """Return the request of an RPC. Raises RpcError "invalid", which says what is wrong."""
    check_size(rpc.name, len(payload), limit)
    try:
        return rpc.request.model_validate_json(payload or b"{}")
    except ValidationError as error:
        raise RpcError("invalid", f"{rpc.name}: {_message(error)}") from None


def _message(error: ValidationError) -> str:
    lines = []
    for item in error.errors(include_url=False, include_input=False)[:5]:
        where = ".".join(str(part) for part in item["loc"])
        what = item["msg"].removeprefix("Value error, ")
        what = {"extra_forbidden": "unknown field", "missing": "missing"}.get(item["type"], what)
        lines.append(f"{where}: {what}" if where else what)
    return "; ".join(lines)
