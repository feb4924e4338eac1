"""What a client takes for an answer or a message of the daemon; whatever else came is an error.

Nobody but the daemon speaks for a bench, as long as it is the daemon that listens at the endpoint.
On a TCP port that can be another program of the machine: nothing that it says may bring a client
down.
"""

from collections.abc import Callable, Sequence
from typing import Annotated, Any, TypeVar

import numpy as np
import zenoh
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from motord.api.endpoints import MAX_ANSWER_BYTES
from motord.api.messages import BenchState, Event, PlanView
from motord.client.error import ClientError
from motord.schema import TICK
from motord.wire.ticks.blocks import BlockCodec

_Text = Annotated[str, Field(max_length=4096)]
_Seconds = Annotated[float, Field(gt=0, lt=1e6, allow_inf_nan=False)]
_Item = TypeVar("_Item")


class Answer(BaseModel):
    """The answer to an RPC: strict types; what is not known is passed on."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True)


class Terms(Answer):
    """`lease/renew`: how long the lease lasts and within what time it is never lost."""

    lease_s: _Seconds
    renew_within_s: _Seconds


class Granted(Terms):
    """`lease/acquire`."""

    token: Annotated[str, Field(min_length=1, max_length=128)]
    took_over_from: _Text | None


class InState(Answer):
    """`enable`, `disable`, `stop`, `reset`."""

    state: _Text


_Number = Annotated[float, Field(allow_inf_nan=False)]


class SetPoint(Answer):
    """What is asked of the bench now; the torque is on its way to its target."""

    torque_Nm: _Number
    torque_target_Nm: _Number
    speed_Hz: _Number | None
    brake: _Number
    drive_Hz: _Number
    compensate: _Text


class SetTo(InState):
    """`set`."""

    setpoint: SetPoint
    reached_in_s: Annotated[float, Field(ge=0, lt=1e6, allow_inf_nan=False)]


class Steered(InState):
    """`plan/pause`, `plan/resume`, `plan/abort`."""

    plan: _Text


class Discarded(Answer):
    """`plan/discard`."""

    plan: _Text


class Outline(Answer):
    """`plan/start`."""

    points: list[dict[str, Any]]
    estimate_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    settings: dict[str, Any]


class Offered(Answer):
    """A plan in `plan/list`."""

    name: _Text
    summary: _Text
    settings: dict[str, Any]


class Offers(Answer):
    """`plan/list`."""

    plans: list[Offered]


class Configured(Answer):
    """`config`."""

    toml: str
    config: dict[str, Any]


class Installed(Answer):
    """`calibration/install`."""

    id: _Text
    age: _Text
    path: _Text


class RefusedReply(Answer):
    """An error reply."""

    code: Annotated[str, Field(min_length=1, max_length=64)]
    message: _Text


ANSWERS: dict[str, type[Answer]] = {
    "lease/acquire": Granted,
    "lease/renew": Terms,
    "enable": InState,
    "disable": InState,
    "stop": InState,
    "reset": InState,
    "set": SetTo,
    "plan/start": Outline,
    "plan/pause": Steered,
    "plan/resume": Steered,
    "plan/abort": Steered,
    "plan/discard": Discarded,
    "plan/list": Offers,
    "config": Configured,
    "calibration/install": Installed,
}
"""By RPC; of the others any object will do."""

_CODEC = BlockCodec(TICK)
_EVENTS: TypeAdapter[list[Event]] = TypeAdapter(list[Event])
_PLAN: TypeAdapter[PlanView | None] = TypeAdapter(PlanView | None)
_TIMEOUT = b"Timeout"
"""Zenoh's own error reply."""


def _decoder(parse: Callable[[bytes], _Item], what: str) -> Callable[[bytes], _Item]:
    def decode(content: bytes) -> _Item:
        if len(content) > MAX_ANSWER_BYTES:
            raise _wrong(f"{what} of {len(content)} bytes, at most {MAX_ANSWER_BYTES}")
        try:
            return parse(content)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(str(part) for part in first["loc"][:4])
            raise _wrong(f"{what}: {where + ': ' if where else ''}{first['msg']}") from None
        except (ValueError, RecursionError) as error:
            raise _wrong(f"{what}: {error}") from None

    return decode


decode_state: Callable[[bytes], BenchState] = _decoder(BenchState.model_validate_json, "a state")
decode_event: Callable[[bytes], Event] = _decoder(Event.model_validate_json, "an event")
decode_events: Callable[[bytes], list[Event]] = _decoder(_EVENTS.validate_json, "events")
decode_plan: Callable[[bytes], PlanView] = _decoder(PlanView.model_validate_json, "a plan")
decode_plan_or_none: Callable[[bytes], PlanView | None] = _decoder(_PLAN.validate_json, "a plan")
decode_ticks: Callable[[bytes], np.ndarray] = _decoder(_CODEC.decode_list, "ticks")
_decode_refused: Callable[[bytes], RefusedReply] = _decoder(
    RefusedReply.model_validate_json, "an error"
)


def decode_answer(name: str, content: bytes) -> dict[str, Any]:
    """Return the answer to RPC `name`. Raises ClientError "bad_answer" if it is none."""
    model = ANSWERS.get(name, Answer)
    return _decoder(model.model_validate_json, f"an answer to {name}")(content).model_dump()


def only_answer(replies: Sequence[zenoh.Reply], asked_key: str, timeout_s: float) -> bytes | None:
    """Return the content of the one answer on `asked_key`, None if there is none.

    Raises ClientError: what the daemon refuses with, "unreachable" if it took too long,
    "bad_answer" for several answers, one on another key, or an error in no known form.
    """
    given = [r for r in replies if r.err is None or r.err.payload.to_bytes() != _TIMEOUT]
    if len(given) > 1:
        who = ", ".join(sorted({str(reply.replier_id) for reply in given}))
        raise _wrong(
            f"{len(given)} answers to {asked_key}, from {who}: somebody answers besides it"
        )
    if not given and replies:
        raise ClientError("unreachable", f"{asked_key}: no answer within {timeout_s:g} s")
    if not given:
        return None
    [reply] = given
    if reply.err is not None:
        refused = _decode_refused(reply.err.payload.to_bytes())
        raise ClientError(refused.code, refused.message)
    assert reply.ok is not None
    if str(reply.ok.key_expr) != asked_key or reply.ok.kind != zenoh.SampleKind.PUT:
        raise _wrong(f"an answer on {reply.ok.key_expr} where {asked_key} was asked for")
    return reply.ok.payload.to_bytes()


def _wrong(what: str) -> ClientError:
    return ClientError(
        "bad_answer", f"not what the daemon says: {what}; is another program listening there?"
    )
