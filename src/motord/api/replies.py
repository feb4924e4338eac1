"""Replies of the RPCs: built by the service, checked by the client, which trusts no daemon.

Types are strict; fields that a model does not name are passed on, so that replies may grow.
"""

import json
from typing import Annotated, Any

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


class AcceptedSetpoint(RpcReply):
    """The set-point after `set`; the torque is on its way to its target."""

    torque_Nm: Number
    """Asked of the loop now; 0 while the brake rises."""
    torque_target_Nm: Number
    """What was set."""
    speed_Hz: Number | None
    """Speed that the brake holds, turns per second."""
    brake: Number
    """Excitation of the brake."""
    drive_Hz: Number
    """Speed of the external drive, turns per second."""
    compensate: Text
    """Which parts of the calibration are applied."""


class SetpointReply(StateReply):
    """`set`."""

    setpoint: AcceptedSetpoint
    """What is in force now."""
    reached_in_s: Duration
    """How long brake and ramp take from now."""


class PlanName(RpcReply):
    """`plan/discard`."""

    plan: Text
    """Name of the plan."""


class PlanProgress(StateReply, PlanName):
    """`plan/pause`, `plan/resume`, `plan/abort`: all of `messages.PlanView`."""


class PlanOutline(RpcReply):
    """`plan/start`: what the plan will do."""

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


class AvailablePlan(RpcReply):
    """A plan in `plan/list`."""

    name: Text
    """For `plan/start`."""
    summary: Text
    """What it does."""
    settings: dict[str, Any]
    """`[plans.<name>]` with all defaults."""


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


class ErrorReply(RpcReply):
    """The body of an error reply."""

    code: Annotated[str, Field(min_length=1, max_length=64)]
    message: Text
