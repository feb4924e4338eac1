"""Commands of the supervisor to the recorder: JSON objects, one a line."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from motord.recorder.blackbox import BlackBoxRequest, checked_event
from motord.recorder.session import Session
from motord.recording.errors import RecordError

TIME_MAX_NS = (1 << 63) - 1

Command = Mapping[str, Any]


def handle(session: Session, line: bytes, now_s: float) -> None:
    """Carry out a command, a JSON object with `do` and what belongs to it:

    - start: `out` (path without number and suffix), `metadata`, `resume`, `first_tick`
    - stop: `reason`
    - event, plan, operating_point: `t_ns`, `content`
    - metadata: `name`, `content`
    - blackbox: `path`, `tick`, `ticks_before`, `ticks_after`, `metadata`, `account`, `events`
    - blackbox_event: `t_ns`, `content`

    What cannot be carried out is the session's `error`.
    """
    try:
        command = json.loads(line)
        _COMMANDS[command["do"]](session, command, now_s)
    except RecordError as error:
        session.error = str(error)
    except OSError as error:
        session.error = f"{error.filename or 'the system'}: {error.strerror or error}"
    except (ValueError, KeyError, TypeError) as error:
        text = line[:200].decode(errors="replace")
        session.error = f"command not understood ({error!r}): {text}"


def _start(session: Session, command: Command, now_s: float) -> None:
    first_tick = command.get("first_tick")
    session.start(
        Path(command["out"]),
        command["metadata"],
        now_s,
        resume=bool(command.get("resume", False)),
        first_tick=None if first_tick is None else int(first_tick),
    )


def _stop(session: Session, command: Command, now_s: float) -> None:
    session.stop(str(command.get("reason", "asked to")), now_s)


def _event(session: Session, command: Command, now_s: float) -> None:
    t_ns, content = _time_ns(command), _mapping(command["content"])
    kind, message = content["kind"], content["message"]
    data = _mapping(content.get("data", {}))
    session.write(lambda writer: writer.event(t_ns, kind, message, data))


def _plan(session: Session, command: Command, now_s: float) -> None:
    t_ns, content = _time_ns(command), _mapping(command["content"])
    session.write(lambda writer: writer.plan(t_ns, content))


def _operating_point(session: Session, command: Command, now_s: float) -> None:
    t_ns, content = _time_ns(command), _mapping(command["content"])
    session.step(now_s)  # its ticks first: a file that holds the point holds them, too
    session.write(lambda writer: writer.operating_point(t_ns, content))


def _metadata(session: Session, command: Command, now_s: float) -> None:
    name, content = str(command["name"]), _mapping(command["content"])
    session.write(lambda writer: writer.metadata(name, content))


def _blackbox(session: Session, command: Command, now_s: float) -> None:
    session.boxes.request(BlackBoxRequest.from_command(command), now_s)


def _blackbox_event(session: Session, command: Command, now_s: float) -> None:
    session.boxes.event(checked_event({"t_ns": _time_ns(command), **command["content"]}))


_COMMANDS: dict[str, Callable[[Session, Command, float], None]] = {
    "start": _start,
    "stop": _stop,
    "event": _event,
    "plan": _plan,
    "operating_point": _operating_point,
    "metadata": _metadata,
    "blackbox": _blackbox,
    "blackbox_event": _blackbox_event,
}


def _time_ns(command: Command) -> int:
    t_ns = int(command["t_ns"])
    if abs(t_ns) > TIME_MAX_NS:
        raise ValueError("t_ns is no time")
    return t_ns


def _mapping(content: object) -> Mapping[str, Any]:
    if not isinstance(content, Mapping):
        raise TypeError("a JSON object is wanted")
    return content
