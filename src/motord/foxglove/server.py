"""The WebSocket server of the Foxglove SDK with motord's topics. Nothing of it blocks."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from foxglove import Channel, Context, Parameter, Schema, StatusLevel, start_server
from foxglove.websocket import Capability, Client, ServerListener, WebSocketServer

from motord.foxglove.topics import SERVED
from motord.process.allowance import Allowance

HOST = "127.0.0.1"
DISCONNECTED = "disconnected"
READ_ONLY = "read-only"
REFUSED_PER_S, REFUSED_AT_ONCE = 5.0, 20.0
"""How often all viewers are notified of a refused change, on average and at once."""


class FoxgloveError(Exception):
    """The server cannot be started: what, where, what to do."""


class ReadOnlyParameters(ServerListener):
    """Parameters that viewers see and cannot change.

    What is refused, with `refused`, the SDK passes on to all viewers, and disconnects those with
    1,024 such messages waiting: a viewer that asks without end must not cost the others theirs.
    """

    def __init__(
        self, refused: Callable[[], None], clock_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.values: dict[str, Any] = {}
        self._refused = refused
        self._clock_ns = clock_ns
        self._allowance = Allowance(REFUSED_PER_S, REFUSED_AT_ONCE)

    def on_get_parameters(
        self, client: Client, param_names: list[str], request_id: str | None = None
    ) -> list[Parameter]:
        """Return the parameters of these names, all of them if none is named."""
        return self.parameters(param_names)

    def on_set_parameters(
        self, client: Client, parameters: list[Parameter], request_id: str | None = None
    ) -> list[Parameter]:
        """Return the parameters as they are: nothing is changed."""
        if not self._allowance.spend(1, self._clock_ns()):
            return []
        self._refused()
        return self.parameters([one.name for one in parameters])

    def parameters(self, names: list[str]) -> list[Parameter]:
        """Return the parameters of these names, all of them if none is named."""
        wanted = {name: self.values[name] for name in names or self.values if name in self.values}
        return [Parameter(name, value=value) for name, value in wanted.items()]


class FoxgloveServer:
    """Serves the topics of `topics.SERVED` on 127.0.0.1; raises FoxgloveError if it cannot.

    A viewer that reads too slowly loses the oldest of its messages, in the SDK; nothing waits.
    """

    def __init__(self, name: str, port: int) -> None:
        self._context = Context()  # the SDK forgets the channels of a context that is gone
        self._parameters = ReadOnlyParameters(self._refuse)
        try:
            self._server: WebSocketServer = start_server(
                name=name, host=HOST, port=port, context=self._context,
                capabilities=[Capability.Parameters], server_listener=self._parameters,
            )  # fmt: skip
        except (RuntimeError, OverflowError) as error:
            raise FoxgloveError(
                f"cannot listen on port {port} of {HOST}: {error}; "
                "another program may use it: choose one with --port, 0 takes any that is free"
            ) from None
        self._channels = {
            topic.name: Channel(
                topic.name,
                schema=Schema(
                    name=topic.schema_name, encoding=topic.schema_encoding, data=topic.schema
                ),
                message_encoding=topic.encoding,
                context=self._context,
            )
            for topic in SERVED
        }

    @property
    def url(self) -> str:
        """Where viewers connect to."""
        return f"ws://{HOST}:{self._server.port}"

    def wanted(self, *topics: str) -> bool:
        """Return whether any viewer subscribes to one of `topics`."""
        return any(self._channels[name].has_sinks() for name in topics)

    def log(self, topic: str, message: bytes, t_ns: int) -> None:
        """Send a message of `topic` with log time `t_ns` (Unix ns) to its subscribers."""
        self._channels[topic].log(message, log_time=max(0, t_ns))

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Replace the parameters, and publish them to who subscribes to them."""
        self._parameters.values = dict(values)
        self._server.publish_parameter_values(self._parameters.parameters([]))

    def say_disconnected(self, message: str) -> None:
        """Show viewers that nothing comes from the daemon, until `say_connected`."""
        self._server.publish_status(message, StatusLevel.Error, DISCONNECTED)

    def say_connected(self) -> None:
        """Take back what `say_disconnected` showed."""
        self._server.remove_status([DISCONNECTED])

    def stop(self) -> None:
        """End all connections."""
        self._server.stop()

    def _refuse(self) -> None:
        text = "parameters are the bench file's: change them there and start the daemon again"
        self._server.publish_status(text, StatusLevel.Warning, READ_ONLY)
