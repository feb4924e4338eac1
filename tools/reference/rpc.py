"""The page of keys, requests and published messages."""

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from tools.reference.attributes import described_values, summary
from tools.reference.bench_file import anchor
from tools.reference.keys_and_events import EVENT_MEANING, KEYS
from tools.reference.markdown import code, page, table
from tools.reference.models import fields, output_fields

from motord.api import errors, messages
from motord.api.plan_messages import PlanView
from motord.api.queue_messages import QueuedPlan, QueueItem, QueueRun, QueueView
from motord.api.replies import AcceptedSetpoint, AvailablePlan, CalibrationEntry
from motord.api.requests import RPCS, PlanStart, Rpc
from motord.security.access import READ

PARTS = (
    messages.SetpointView, AvailablePlan, CalibrationEntry, QueuedPlan, QueueItem, QueueRun,
    QueueView,
)  # fmt: skip
"""Parts of requests and replies that have a section of their own."""
MESSAGES = (messages.BenchState, PlanView, messages.Event)
INTRO = """Everything is under `motord/<bench>/`, where `<bench>` is `[bench] name`. How to talk to
a bench, and who is in command of it: [Talking to a running bench](../api.md)."""
RPC_INTRO = """A request is a Zenoh query on `rpc/<name>` whose payload is a JSON object; the reply
is a JSON object, or an error reply with `code` and `message`. *Lease*: the token of the lease in
force is needed. *Viewer*: an identity with the role viewer may ask it, too
([roles](../security.md))."""


def rpc() -> str:
    """Return the page of keys, requests and messages."""
    keys = [(code(name), *about) for name, *about in KEYS]
    overview = [
        (f"[`{name}`](#{anchor(name)})", lease_of(one), "yes" if f"rpc/{name}" in READ else "")
        for name, one in RPCS.items()
    ]
    codes = [(code(name), text) for name, text in described_values(errors, "Code").items()]
    kinds = [(code(name), text) for name, text in EVENT_MEANING.items()]
    return page(
        "Keys and RPCs",
        "motord.api",
        INTRO,
        "## Keys",
        table(("key", "what", "as", "a query returns"), keys),
        "## Requests",
        RPC_INTRO,
        table(("request", "lease", "viewer"), overview),
        *(part for one in RPCS.values() for part in _request(one)),
        "## Error codes",
        table(("code", "meaning"), codes),
        "## Kinds of events",
        table(("kind", "what it is about"), kinds),
        "## Published messages",
        *_messages(),
    )


def lease_of(one: Rpc[Any, Any]) -> str:
    """Return whether a request needs the lease."""
    if one.request is PlanStart:
        return "yes, but for a dry run"
    return "yes" if one.needs_lease else ""


def _request(one: Rpc[Any, Any]) -> Iterator[str]:
    links = {model.__name__: f"[`{model.__name__}`](#{anchor(model.__name__)})" for model in PARTS}
    links[AcceptedSetpoint.__name__] = links[messages.SetpointView.__name__]  # the same fields
    yield f"### {one.name}"
    yield one.meaning or summary(one.request)
    if one.request.model_fields:
        yield fields(one.request, links)
    if one.reply.model_fields:
        yield f"Reply, `{one.reply.__name__}`:"
        yield output_fields(one.reply, links)
    else:
        yield "The reply is empty."


def _messages() -> Iterator[str]:
    seen: dict[str, type[BaseModel]] = {}
    todo: list[type[BaseModel]] = [*MESSAGES, *PARTS]
    while todo:
        model = todo.pop(0)
        if model.__name__ not in seen:
            seen[model.__name__] = model
            todo += [one for one in _models_in(model) if one.__name__ not in seen]
    links = {name: f"[`{name}`](#{anchor(name)})" for name in seen}
    for name, model in seen.items():
        yield f"### {name}"
        yield summary(model)
        yield output_fields(model, links)


def _models_in(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """Yield the models that the fields of a model hold."""
    for field in model.model_fields.values():
        todo = [field.annotation]
        while todo:
            kind = todo.pop()
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield kind
            todo += getattr(kind, "__args__", ())
