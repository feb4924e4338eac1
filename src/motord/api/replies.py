"""Replies of the RPCs: built by the service, checked by the client, which trusts no daemon.

Types are strict; fields that a model does not name are passed on, so that replies may grow.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from motord.api.errors import MESSAGE_CHARACTERS
from motord.api.messages import SetpointView

Text = Annotated[str, Field(max_length=MESSAGE_CHARACTERS)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Duration = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_LeaseTime = Annotated[float, Field(gt=0, lt=1e6, allow_inf_nan=False)]


class RpcReply(BaseModel, extra="allow", strict=True, frozen=True):
    """The reply to an RPC, a JSON object; without fields for an RPC that has nothing to say."""

    def content(self) -> dict[str, Any]:
        """Return the fields that were given, as in JSON."""
        return self.model_dump(mode="json", exclude_unset=True)

    def to_json(self) -> bytes:
        """Return `content` as JSON in UTF-8; numbers that are not finite become null."""
        return self.model_dump_json(exclude_unset=True).encode()


class LeaseTerms(RpcReply):
    """`lease/renew`: how long the lease lasts and within what time it is never lost."""

    lease_s: _LeaseTime
    """After the last renewal no torque is left so soon."""
    renew_within_s: _LeaseTime
    """A lease that is renewed within this time is never lost."""


class LeaseGrant(LeaseTerms):
    """`lease/acquire`."""

    token: Annotated[str, Field(min_length=1, max_length=128)]
    """For the requests of this lease."""
    took_over_from: Text | None
    """Who was in command until now."""
    holder: Text = ""
    """Who is in command."""


class StateReply(RpcReply):
    """`enable`, `disable`, `stop`, `reset`: the state of the drive."""

    state: Text
    """State of the drive, or of the plan."""


class AcceptedSetpoint(SetpointView, extra="allow", strict=True, frozen=True, allow_inf_nan=False):
    """What the state publishes of the set-point, as strict as other replies."""


class SetpointReply(StateReply):
    """`set`."""

    setpoint: AcceptedSetpoint
    """What is in force now; the torque is on its way to its target."""
    reached_in_s: Duration
    """How long brake and ramp take from now."""


class NoteReply(RpcReply):
    """`note`."""

    t_ns: int
    """Its time, Unix."""
    recording: Text
    """The file that has it, "" if nothing is recorded."""


class PlanName(RpcReply):
    """`plan/discard`."""

    plan: Text
    """Name of the plan."""


class PlanProgress(StateReply, PlanName):
    """`plan/pause`, `plan/resume`, `plan/abort`: all of `messages.PlanView`."""


class PlanOutline(RpcReply):
    """`plan/start`: what the plan will do; `run_id` of its progress, "" in a dry run."""

    points: list[dict[str, Any]]
    """The operating points, as they will be taken."""
    estimate_s: Duration
    """How long it will take, about."""
    settings: dict[str, Any]
    """With which it starts, defaults included."""
    plan: Text = ""
    """Name of the plan."""
    recording: Text = ""
    """Path of its recording once it is whole."""
    run_id: Text = ""
    """Of its progress; "" in a dry run."""
    outlook: Text = ""
    """What is to be expected of a plan that ends when it is good enough; "" of others."""


class SettingField(RpcReply):
    """A setting of a plan, as a form shows it; in `plan/list`."""

    name: Text
    """As `plan/start` takes it."""
    type: Literal[
        "number", "integer", "boolean", "text", "choice", "list", "table", "object", "other"
    ]
    """What kind of value it has; object: settings by name."""
    unit: Text = ""
    """Of the value."""
    default: Any = None
    """Of the bench file."""
    minimum: Number | None = None
    """Smallest value, or of each value of a list."""
    minimum_excluded: bool = False
    """The value must be above it."""
    maximum: Number | None = None
    """Largest value, or of each value of a list."""
    maximum_excluded: bool = False
    """The value must be below it."""
    choices: list[Text] = []
    """Values that a choice has."""
    length_min: int = 0
    """Fewest values of a list, or rows of a table."""
    length_max: int | None = None
    """Most values of a list, or rows of a table."""
    columns: list[Text] = []
    """Of a table, whose rows are objects."""
    optional: bool = False
    """null is a value, too."""
    help: Text = ""
    """What it means, in one line."""


class AvailablePlan(RpcReply):
    """A plan in `plan/list`: its settings as the bench file has them, and as `fields` of a form."""

    name: Text
    """For `plan/start`."""
    summary: Text
    """What it does."""
    settings: dict[str, Any]
    """`[plans.<name>]` with all defaults."""
    fields: list[SettingField] = []
    """What a form of them needs."""
    needs: Text = ""
    """The device that it cannot do without."""
    obstacle: Text = ""
    """Why it cannot run with these settings, "" if nothing is known to be in its way."""


class PlanList(RpcReply):
    """`plan/list`."""

    plans: list[AvailablePlan]
    """In their order."""


class ConfigReply(RpcReply):
    """`config`: the bench file as text, and with all defaults."""

    toml: str
    """The bench file."""
    config: dict[str, Any]
    """The same with all defaults."""


class InstalledCalibration(RpcReply):
    """`calibration/install`; `path` once it is on disk."""

    id: Text
    """Its hash."""
    age: Text
    """As text."""
    path: Text
    """Where the daemon keeps it."""
    created: Text = ""
    """When it was made."""


Interval = Annotated[list[Number], Field(min_length=2, max_length=2)]
"""From, to."""


class CalibrationEntry(RpcReply):
    """A calibration in `calibration/list`."""

    id: Text
    """Its hash."""
    created: Text
    """When it was made."""
    age_s: Number
    """Since then."""
    age: Text
    """The same as text."""
    method: Text
    """The estimator."""
    motor: dict[str, Any]
    """What has to agree with `[motor]`."""
    in_force: bool
    """It is applied now."""
    path: Text
    """Where the daemon keeps it."""


class CalibrationList(RpcReply):
    """`calibration/list`."""

    calibrations: list[CalibrationEntry]
    """The newest first."""
    unreadable: list[Text]
    """Which files are none, and why."""


class CalibrationDetails(CalibrationEntry):
    """`calibration/show`: as in the file, with 95 % intervals and the cogging torque in short."""

    runs: list[str]
    """Recordings that it was made of."""
    alpha: list[Number]
    """Gains of the phase currents."""
    alpha_stderr: list[Number]
    """Their standard errors."""
    alpha_95: list[Interval]
    """Their 95 % intervals."""
    beta_A: list[Number]
    """Offsets of the phase currents."""
    beta_stderr_A: list[Number]
    """Their standard errors."""
    beta_95_A: list[Interval]
    """Their 95 % intervals."""
    degrees_of_freedom: dict[str, Any] | None = None
    """Of the standard errors: `alpha`, `beta_A`, `delta_epsilon`; none in files from before."""
    delta_epsilon: Number
    """Common gain of the currents."""
    delta_epsilon_source: str
    """`assumed`, or the recordings that it was measured in."""
    condition_number: Number
    """Of the fit."""
    observable: list[str]
    """What could and could not be separated."""
    findings: list[dict[str, Any]] = []
    """Where its data depart from the model, with value, limit, meaning and what to do."""
    budget: list[dict[str, Any]] = []
    """What each source contributes to the standard uncertainty, Type A and Type B."""
    cramer_rao: dict[str, Any] | None = None
    """Cramer-Rao bound, efficiency, and ripple that the errors leave; none in files from before."""
    learned: bool
    """It holds what was learned on top."""
    rms_error_percent: dict[str, Any]
    """Torque error before and after, percent of rated torque, with halves of its 95 % intervals."""
    tau_cog_harmonics: list[dict[str, Any]]
    """Orders of the cogging torque."""
    tau_cog_half_widths_Nm: list[Number | None] = []
    """Halves of the 95 % intervals of their amplitudes."""
    angle_rad: list[Number]
    """Angles of the curve."""
    tau_cog_Nm: list[Number]
    """Cogging torque at these angles."""


class ErrorReply(RpcReply):
    """The body of an error reply."""

    code: Annotated[str, Field(min_length=1, max_length=64)]
    message: Text
