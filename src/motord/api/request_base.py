"""What all requests are: a row of the table of RPCs, and the models that others derive from."""

from dataclasses import dataclass
from typing import Annotated, Generic, TypeVar

from pydantic import BaseModel, Field

from motord.api.replies import RpcReply
from motord.section import matching

Token = Annotated[str, Field(min_length=1, max_length=128)]
Name = Annotated[
    str,
    Field(min_length=1, max_length=64),
    matching(r"[\w.@:/ -]+", "letters, digits, spaces, _, ., @, :, / and -"),
]


class RpcRequest(BaseModel, extra="forbid", strict=True, frozen=True, allow_inf_nan=False):
    """The body of an RPC: JSON object, strict types, unknown fields refused."""


class NoArguments(RpcRequest):
    """`config`, `plan/list`, `calibration/list`, `queue/list`: nothing."""


class WithToken(RpcRequest):
    """`lease/renew`, `lease/release`, `enable`, `disable`, `reset`, `plan/pause|abort|discard`."""

    token: Token
    """That of the lease in force, as it was granted, without escapes."""


RequestT = TypeVar("RequestT", bound=RpcRequest)
ReplyT = TypeVar("ReplyT", bound=RpcReply)


@dataclass(frozen=True)
class Rpc(Generic[RequestT, ReplyT]):
    """A request `rpc/<name>`, the model of its body, that of its reply, and what it does."""

    name: str
    request: type[RequestT]
    reply: type[ReplyT]
    meaning: str = ""

    @property
    def needs_lease(self) -> bool:
        """True if it is refused without the token of the lease in force."""
        return issubclass(self.request, WithToken)
