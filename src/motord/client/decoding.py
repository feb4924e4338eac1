"""Decoding of replies and published messages: whatever is not of the right form is a ClientError.

On a TCP port another program may listen in place of the daemon: nothing that it sends may bring a
client down.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import zenoh
from pydantic import TypeAdapter, ValidationError

from motord.api.endpoints import MAX_REPLY_BYTES
from motord.api.messages import BenchState, Event
from motord.api.plan_messages import MeshView, PlanView
from motord.api.replies import ErrorReply
from motord.api.requests import ReplyT, Rpc
from motord.client.error import ClientError
from motord.schema import TICK
from motord.section.complaints import wrong_things
from motord.wire.ticks.blocks import BlockCodec

_Item = TypeVar("_Item")
_CODEC = BlockCodec(TICK)
_EVENTS: TypeAdapter[list[Event]] = TypeAdapter(list[Event])
_PLAN: TypeAdapter[PlanView | None] = TypeAdapter(PlanView | None)
_MESH: TypeAdapter[MeshView | None] = TypeAdapter(MeshView | None)
_TIMEOUT = b"Timeout"
"""Zenoh's own error reply."""


def _decoder(validate: Callable[[bytes], _Item], what: str) -> Callable[[bytes], _Item]:
    def decode(content: bytes) -> _Item:
        if len(content) > MAX_REPLY_BYTES:
            raise _wrong(f"{what} of {len(content)} bytes, at most {MAX_REPLY_BYTES}")
        try:
            return validate(content)
        except ValidationError as error:
            raise _wrong(f"{what}: {next(wrong_things(error))}") from None
        except (ValueError, RecursionError) as error:
            raise _wrong(f"{what}: {error}") from None

    return decode


decode_state: Callable[[bytes], BenchState] = _decoder(BenchState.model_validate_json, "a state")
decode_event: Callable[[bytes], Event] = _decoder(Event.model_validate_json, "an event")
decode_events: Callable[[bytes], list[Event]] = _decoder(_EVENTS.validate_json, "events")
decode_plan: Callable[[bytes], PlanView] = _decoder(PlanView.model_validate_json, "a plan")
decode_plan_or_none: Callable[[bytes], PlanView | None] = _decoder(_PLAN.validate_json, "a plan")
decode_mesh: Callable[[bytes], MeshView] = _decoder(MeshView.model_validate_json, "a mesh")
decode_mesh_or_none: Callable[[bytes], MeshView | None] = _decoder(_MESH.validate_json, "a mesh")
decode_ticks: Callable[[bytes], np.ndarray] = _decoder(_CODEC.decode_list, "ticks")
_decode_error: Callable[[bytes], ErrorReply] = _decoder(ErrorReply.model_validate_json, "an error")


def decode_reply(rpc: Rpc[Any, ReplyT], content: bytes) -> ReplyT:
    """Return the reply to an RPC. Raises ClientError "bad_answer"."""
    return _decoder(rpc.reply.model_validate_json, f"an answer to {rpc.name}")(content)


def no_reply_in_time(key: str, timeout_s: float) -> ClientError:
    """Return the error for a request to `key` without a reply."""
    return ClientError("unreachable", f"{key}: no answer within {timeout_s:g} s")


def single_reply(replies: Sequence[zenoh.Reply], key: str, timeout_s: float) -> bytes | None:
    """Return the payload of the one reply on `key`, None if there is none.

    Raises ClientError: the daemon's own code, "unreachable" for a timeout, "bad_answer" for several
    replies, one on another key, or an error in no known form.
    """
    given = [r for r in replies if r.err is None or r.err.payload.to_bytes() != _TIMEOUT]
    if len(given) > 1:
        who = ", ".join(sorted({str(reply.replier_id) for reply in given}))
        raise _wrong(f"{len(given)} answers to {key}, from {who}: another program answers, too")
    if not given and replies:
        raise no_reply_in_time(key, timeout_s)
    if not given:
        return None
    [reply] = given
    if reply.err is not None:
        error = _decode_error(reply.err.payload.to_bytes())
        raise ClientError(error.code, error.message)
    assert reply.ok is not None
    if str(reply.ok.key_expr) != key or reply.ok.kind != zenoh.SampleKind.PUT:
        raise _wrong(f"an answer on {reply.ok.key_expr} where {key} was asked for")
    return reply.ok.payload.to_bytes()


def _wrong(what: str) -> ClientError:
    return ClientError(
        "bad_answer", f"not what the daemon says: {what}; is another program listening there?"
    )
