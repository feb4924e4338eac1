"""What a page may send (decision 0024), checked field by field."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, TypeAdapter, ValidationError

from motord.api.requests import MAX_REQUEST_BYTES
from motord.dashboard.frames import FrameError, decode
from motord.dashboard.history import BUCKETS_MAX, RETENTION_S
from motord.dashboard.signals import ROW
from motord.section.complaints import wrong_things

MAX_BYTES = MAX_REQUEST_BYTES + 1024
"""The longest message: a request in its envelope."""
VIEWS_MAX = 32
SPAN_MAX_S = RETENTION_S[-1]
END_MAX_S = 1e9
"""Windows end within 30 years of the server's start."""


def _known(name: str) -> str:
    if name not in ROW:
        raise ValueError(f"no signal {name}; there are {', '.join(ROW)}")
    return name


SignalName = Annotated[str, AfterValidator(_known)]


class _FromPage(BaseModel, extra="ignore", frozen=True, allow_inf_nan=False):
    """A message out of a page."""


class ViewWanted(_FromPage):
    """A window of `span_s` that ends at `end_s` (null: now), in at most so many buckets."""

    kind: Literal["view"]
    view: Annotated[int, Field(ge=0, lt=VIEWS_MAX)]
    span_s: Annotated[float, Field(gt=0, le=SPAN_MAX_S)]
    end_s: Annotated[float, Field(ge=-END_MAX_S, le=END_MAX_S)] | None = None
    buckets: Annotated[int, Field(ge=1, le=BUCKETS_MAX)]
    signals: Annotated[list[SignalName], Field(max_length=len(ROW))]


class Visible(_FromPage):
    """Whether anybody can see the page."""

    kind: Literal["visible"]
    value: bool


class RpcCall(_FromPage):
    """A request to the daemon, or for the lease; answered by a `reply` with the same `id`."""

    kind: Literal["rpc"]
    id: Annotated[int, Field(ge=0, lt=2**53)]
    name: Annotated[str, Field(max_length=64)]
    arguments: dict[str, Any] = {}


class Pong(_FromPage):
    """The answer to `ping` `n`."""

    kind: Literal["pong"]
    n: int


PageMessage = ViewWanted | Visible | RpcCall | Pong
_MESSAGES: TypeAdapter[PageMessage] = TypeAdapter(
    Annotated[PageMessage, Field(discriminator="kind")]
)
KINDS = frozenset(("view", "visible", "rpc", "pong"))


def read(message: bytes) -> PageMessage | None:
    """Return a page's message, None for a kind that is not known. Raises FrameError."""
    header, _ = decode(message)
    if header["kind"] not in KINDS:
        return None
    try:
        return _MESSAGES.validate_python(header)
    except ValidationError as error:
        raise FrameError(f"{header['kind']}: {next(wrong_things(error))}") from None
    except UnicodeEncodeError:
        raise FrameError(f"{header['kind']}: half of a surrogate pair is no text") from None
