"""Replies of the RPCs: built by the service, checked by the client, which trusts no daemon.

Types are strict; fields that a model does not name are passed on, so that replies may grow.
"""

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Text = Annotated[str, Field(max_length=4096)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Duration = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_LeaseTime = Annotated[float, Field(gt=0, lt=1e6, allow_inf_nan=False)]


class RpcReply(BaseModel):
    """The reply to an RPC, a JSON object; without fields for an RPC that has nothing to say."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True)

    def content(self) -> dict[str, Any]:
        """Return the fields that were given, as in JSON."""
        return self.model_dump(mode="json", exclude_unset=True)

    def to_json(self) -> bytes:
        """Return `content` as JSON in UTF-8."""
        return json.dumps(self.content()).encode()


class LeaseTerms(RpcReply):
    """`lease/renew`: how long the lease lasts and within what time it is never lost."""

    lease_s: _LeaseTime
    renew_within_s: _LeaseTime


class LeaseGrant(LeaseTerms):
    """`lease/acquire`."""

    token: Annotated[str, Field(min_length=1, max_length=128)]
    took_over_from: Text | None
    holder: Text = ""


class StateReply(RpcReply):
    """`enable`, `disable`, `stop`, `reset`: the state of the drive."""

    state: Text


class AcceptedSetpoint(RpcReply):
    """The set-point after `set`; the torque is on its way to its target."""

    torque_Nm: Number
    torque_target_Nm: Number
    speed_Hz: Number | None
    brake: Number
    drive_Hz: Number
    compensate: Text


class SetpointReply(StateReply):
    """`set`."""

    setpoint: AcceptedSetpoint
    reached_in_s: Duration


class NoteReply(RpcReply):
    """`note`: its time (Unix ns), and the recording that it is in ("": none, an event only)."""

    t_ns: int
    recording: Text


class PlanName(RpcReply):
    """`plan/discard`."""

    plan: Text


class PlanProgress(StateReply, PlanName):
    """`plan/pause`, `plan/resume`, `plan/abort`: all of `messages.PlanView`."""


class PlanOutline(RpcReply):
    """`plan/start`: what the plan will do."""

    points: list[dict[str, Any]]
    estimate_s: Duration
    settings: dict[str, Any]
    plan: Text = ""
    recording: Text = ""


class SettingField(RpcReply):
    """A setting of a plan, as a form shows it; in `plan/list`.

    minimum, maximum: of the value, or of each value of a list, themselves excluded if `*_excluded`;
    length_*: of a list or a table; columns: of a table, whose rows are objects. optional: null is a
    value, too.
    """

    name: Text
    type: Literal["number", "integer", "boolean", "text", "choice", "list", "table", "other"]
    unit: Text = ""
    default: Any = None
    minimum: Number | None = None
    minimum_excluded: bool = False
    maximum: Number | None = None
    maximum_excluded: bool = False
    choices: list[Text] = []
    length_min: int = 0
    length_max: int | None = None
    columns: list[Text] = []
    optional: bool = False
    help: Text = ""


class AvailablePlan(RpcReply):
    """A plan in `plan/list`: its settings as the bench file has them, and as `fields` of a form.

    needs: the device that it cannot do without; obstacle: why it cannot run with these settings,
    "" if nothing is known to be in its way.
    """

    name: Text
    summary: Text
    settings: dict[str, Any]
    fields: list[SettingField] = []
    needs: Text = ""
    obstacle: Text = ""


class PlanList(RpcReply):
    """`plan/list`."""

    plans: list[AvailablePlan]


class ConfigReply(RpcReply):
    """`config`: the bench file as text, and with all defaults."""

    toml: str
    config: dict[str, Any]


class InstalledCalibration(RpcReply):
    """`calibration/install`; `path` once it is on disk."""

    id: Text
    age: Text
    path: Text
    created: Text = ""


Interval = Annotated[list[Number], Field(min_length=2, max_length=2)]
"""From, to."""


class CalibrationEntry(RpcReply):
    """A calibration in `calibration/list`; `motor` is what has to agree with `[motor]`."""

    id: Text
    created: Text
    age_s: Number
    age: Text
    method: Text
    motor: dict[str, Any]
    in_force: bool
    path: Text


class CalibrationList(RpcReply):
    """`calibration/list`: the newest first; `unreadable` says which files are none, and why."""

    calibrations: list[CalibrationEntry]
    unreadable: list[Text]


class CalibrationDetails(CalibrationEntry):
    """`calibration/show`: as in the file, with 95 % intervals and the cogging torque in short."""

    runs: list[str]
    alpha: list[Number]
    alpha_stderr: list[Number]
    alpha_95: list[Interval]
    beta_A: list[Number]
    beta_stderr_A: list[Number]
    beta_95_A: list[Interval]
    delta_epsilon: Number
    delta_epsilon_source: str
    condition_number: Number
    observable: list[str]
    learned: bool
    rms_error_percent: dict[str, Any]
    tau_cog_harmonics: list[dict[str, Any]]
    angle_rad: list[Number]
    tau_cog_Nm: list[Number]


class ErrorReply(RpcReply):
    """The body of an error reply."""

    code: Annotated[str, Field(min_length=1, max_length=64)]
    message: Text
