"""What Zenoh's log says about who was refused at the gateway, as messages, and not too often.

Zenoh drops what access control denies without an answer and without a callback; its log is where it
says so. Denials come at level TRACE of `access_control`, refused handshakes as warnings of
`zenoh_link_tls`. A handshake that fails says why, but not who.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

LEVELS = "off,zenoh_link_tls=warn,zenoh::net::routing::interceptor::access_control=trace"
"""What of Zenoh's log is wanted, as `RUST_LOG` has it."""

_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_LINE = re.compile(
    r"\S+ +(?P<level>[A-Z]+) .*?(?P<thread>ThreadId\(\d+\)) (?P<target>[\w:]+): (?P<text>.*)"
)
_ASKS_ALL = re.compile(r"ACL \(\w+\): caching permissions for `(?P<key>.*)` ")
_VERDICT = re.compile(
    r"(?P<cached>Using cached result: )?(?P<zid>[0-9a-f]+)( on (?P<subject>\S+))? is "
    r"(?P<un>un)?authorized to (?P<what>.+) \((?P<flow>ingress|egress)\) on (?P<key>\S+)"
)
_NAME = re.compile(r"CertCommonName\((.*?)\)\+")
_VERDICTS_OF_A_KEY = 9
"""So many verdicts follow when Zenoh works out in advance what is allowed on a key."""

_HANDSHAKES = (
    ("sent no certificates", "it showed no certificate"),
    ("UnknownIssuer", "its certificate is from another authority"),
    ("BadSignature", "its certificate is from another authority"),
    ("expired", "its certificate has expired"),
    ("not valid yet", "its certificate is not valid yet"),
    ("corrupt", "it does not speak TLS"),
)

_ACTIONS = {
    "Query": "ask for",
    "Put": "publish",
    "Delete": "delete",
    "Reply": "answer",
    "Declare Subscriber": "subscribe to",
    "Declare Queryable": "answer",
    "Declare Liveliness Token": "be",
    "Liveliness Token": "be",
    "Liveliness Query": "look for",
    "Declare Liveliness Subscriber": "watch for",
}


@dataclass(frozen=True)
class RefusedConnection:
    """A connection or request that was refused: message and data of the event."""

    message: str
    data: dict[str, Any]


@dataclass
class AuditLog:
    """Reads Zenoh's log line by line; `names`: common names by Zenoh id."""

    roles: Mapping[str, str]
    names: dict[str, str] = field(default_factory=dict)
    _in_advance: dict[str, tuple[str, int]] = field(default_factory=dict)

    def read(self, line: str) -> RefusedConnection | None:
        """Return who was refused what, or None if the line is of nothing refused."""
        found = _LINE.match(_COLOURS.sub("", line))
        if found is None:
            return None
        if found["level"] in ("WARN", "ERROR"):
            return _handshake(found["text"])
        return self._verdict(found["thread"], found["text"])

    def _verdict(self, thread: str, text: str) -> RefusedConnection | None:
        begins = _ASKS_ALL.match(text)
        if begins is not None:
            self._in_advance[thread] = begins["key"], _VERDICTS_OF_A_KEY
            return None
        verdict = _VERDICT.match(text)
        if verdict is None or self._is_in_advance(thread, verdict):
            return None
        if not verdict["un"] or verdict["flow"] == "egress":
            return None
        who = self._name(verdict)
        role = self.roles.get(who, "no role")
        what = _ACTIONS.get(verdict["what"], verdict["what"])
        return RefusedConnection(
            f"refused: {who} ({role}) may not {what} {verdict['key']}",
            {"who": who, "role": role, "action": verdict["what"], "key": verdict["key"]},
        )

    def _is_in_advance(self, thread: str, verdict: re.Match[str]) -> bool:
        key, left = self._in_advance.pop(thread, ("", 0))
        if not left or verdict["cached"] or verdict["key"] != key:
            return False
        self._in_advance[thread] = key, left - 1
        return True

    def _name(self, verdict: re.Match[str]) -> str:
        named = _NAME.search(verdict["subject"] or "")
        if named is not None:
            self.names[verdict["zid"]] = named[1]
        return self.names.get(verdict["zid"], "somebody")


def _handshake(text: str) -> RefusedConnection:
    reason = text.partition(" Hint: ")[0].rstrip(".")
    why = next((why for sign, why in _HANDSHAKES if sign in reason), reason)
    return RefusedConnection(f"refused a connection: {why}", {"reason": reason})


class Throttle:
    """Lets the same message through once in `AGAIN_NS`, and `MOST` different ones in that time."""

    AGAIN_NS = 10_000_000_000
    MOST = 50

    def __init__(self) -> None:
        self._seen: dict[str, tuple[int, int]] = {}  # since when, how often held back since

    def pass_on(self, message: str, now_ns: int) -> str | None:
        """Return what is to be said now: the message, how often it was held back, or None."""
        since_ns, held = self._seen.get(message, (now_ns - self.AGAIN_NS, 0))
        if now_ns - since_ns < self.AGAIN_NS:
            self._seen[message] = since_ns, held + 1
            return None
        if message not in self._seen and len(self._seen) >= self.MOST:
            self._seen = {m: s for m, s in self._seen.items() if now_ns - s[0] < self.AGAIN_NS}
            if len(self._seen) >= self.MOST:
                return None
        self._seen[message] = now_ns, 0
        return f"{message} ({held} more times before)" if held else message
