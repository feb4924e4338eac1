"""A viewer that speaks the Foxglove WebSocket protocol (subprotocol foxglove.sdk.v1), by hand.

It knows nothing of motord: topics, encodings and schemas are those that the server advertises.
"""

import base64
import json
import struct
import time
from collections import deque
from contextlib import ExitStack
from typing import Any, NamedTuple

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.json_format import MessageToDict
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from tests.support.patience import PATIENCE_S

SUBPROTOCOL = "foxglove.sdk.v1"
_MESSAGE_DATA = 1


class ViewedMessage(NamedTuple):
    topic: str
    t_ns: int
    content: Any  # a dict of JSON, or a protobuf message


def message_class(channel: dict[str, Any]) -> Any:
    """Return the class of a protobuf channel's messages, made of what it was advertised with."""
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))


class Viewer:
    """Connects, and collects what the server sends."""

    def __init__(self, url: str) -> None:
        self._stack = ExitStack()
        self._socket = self._stack.enter_context(
            connect(url, subprotocols=[Subprotocol(SUBPROTOCOL)], max_size=2**24)
        )
        self.channels: dict[str, dict[str, Any]] = {}
        self.statuses: list[dict[str, Any]] = []
        self.removed: list[str] = []
        self.parameters: dict[str, Any] | None = None
        self._topics: dict[int, str] = {}
        self._classes: dict[str, Any] = {}
        self._messages: deque[ViewedMessage] = deque()
        assert self._socket.subprotocol == SUBPROTOCOL
        self.info = json.loads(self._socket.recv(timeout=PATIENCE_S))
        assert self.info["op"] == "serverInfo"

    def __enter__(self) -> "Viewer":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._stack.close()

    def hang_up(self) -> None:
        """End the connection at once: one with much to read would wait for the other end."""
        self._socket.close_socket()
        self.close()

    def send(self, **request: Any) -> None:
        self._socket.send(json.dumps(request))

    def receive_until(self, condition: Any, what: str) -> None:
        """Take what comes until `condition()`."""
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, f"waited in vain for: {what}"
            try:
                self._take(self._socket.recv(timeout=0.5))
            except TimeoutError:
                continue

    def subscribe(self, *topics: str) -> None:
        """Subscribe to topics once they are advertised."""
        self.receive_until(lambda: set(topics) <= self.channels.keys(), f"topics {topics}")
        new = []
        for topic in topics:
            channel = self.channels[topic]
            number = 100 + channel["id"]
            self._topics[number] = topic
            if channel["encoding"] == "protobuf":
                self._classes[topic] = message_class(channel)
            new.append({"id": number, "channelId": channel["id"]})
        self.send(op="subscribe", subscriptions=new)

    def next(self, topic: str) -> ViewedMessage:
        """Return the next message of `topic`; those of others before it are dropped."""
        while (message := self.next_of_all()).topic != topic:
            pass
        return message

    def next_of_all(self) -> ViewedMessage:
        """Return the next message of any topic that was subscribed to."""
        self.receive_until(lambda: self._messages, "a message")
        return self._messages.popleft()

    def get_parameters(self, *names: str) -> dict[str, Any]:
        self.parameters = None
        self.send(op="getParameters", parameterNames=list(names), id="get")
        self.receive_until(lambda: self.parameters is not None, "parameters")
        return self.parameters or {}

    def _take(self, data: str | bytes) -> None:
        if isinstance(data, bytes):
            self._take_message(data)
            return
        message = json.loads(data)
        match message["op"]:
            case "advertise":
                self.channels |= {one["topic"]: one for one in message["channels"]}
            case "status":
                self.statuses.append(message)
            case "removeStatus":
                self.removed += message["statusIds"]
            case "parameterValues":
                self.parameters = {one["name"]: one["value"] for one in message["parameters"]}

    def _take_message(self, data: bytes) -> None:
        operation, subscription, t_ns = struct.unpack_from("<BIQ", data)
        assert operation == _MESSAGE_DATA
        topic, payload = self._topics[subscription], data[struct.calcsize("<BIQ") :]
        if topic in self._classes:
            content = self._classes[topic].FromString(payload)
        else:
            assert self.channels[topic]["encoding"] == "json"
            content = json.loads(payload)
        self._messages.append(ViewedMessage(topic, t_ns, content))


def field_names(channel: dict[str, Any]) -> set[str]:
    """Return the paths of all fields that a channel's schema names, as in `plan.state`."""
    if channel["encoding"] == "protobuf":
        return set(_protobuf_names(message_class(channel).DESCRIPTOR, ""))
    return set(_json_names(json.loads(channel["schema"]), ""))


def _protobuf_names(descriptor: Any, prefix: str) -> Any:
    for field in descriptor.fields:
        yield prefix + field.name
        if field.message_type is not None:
            yield from _protobuf_names(field.message_type, f"{prefix}{field.name}.")


def _json_names(schema: dict[str, Any], prefix: str) -> Any:
    for name, item in schema.get("properties", {}).items():
        yield prefix + name
        yield from _json_names(item, f"{prefix}{name}.")


def as_dict(message: Any) -> dict[str, Any]:
    """Return the fields of a protobuf message, those that are zero too."""
    return MessageToDict(
        message, preserving_proto_field_name=True, always_print_fields_with_no_presence=True
    )
