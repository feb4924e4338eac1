"""Commands of the supervisor to the recorder: JSON objects, one a line."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from motord.recorder.finishing import RunMessage
from motord.recorder.protocol import BlackBoxRequest, Mark, checked_event
from motord.recorder.session import Session
from motord.recording.errors import RecordError
from motord.untrusted import parse_json

TIME_MAX_NS = (1 << 63) - 1

Command = Mapping[str, Any]


def handle(session: Session, line: bytes, now_s: float) -> None:
    """Carry out a command, a JSON object (docs/recording.md, "Commands to the recorder").

    What cannot be carried out is the session's `error`.
    """
    try:
        command = parse_json(line)
        _carry_out(session, command, now_s)
    except RecordError as error:
        session.error = str(error)
    except OSError as error:
        session.error = f"{error.filename or 'the system'}: {error.strerror or error}"
    except (ValueError, KeyError, TypeError) as error:
        text = line[:200].decode(errors="replace")
        session.error = f"command not understood ({error!r}): {text}"


def _carry_out(session: Session, command: Command, now_s: float) -> None:
    match command["do"]:
        case "start":
            session.start(
                Path(command["out"]),
                command["metadata"],
                now_s,
                resume=bool(command.get("resume", False)),
                first_tick=_first_tick(command),
                last=_last(command),
            )
        case "finish":
            session.finish(
                Path(command["out"]),
                command["metadata"],
                str(command["reason"]),
                now_s,
                first_tick=_first_tick(command) or 0,
                newest=_newest(command),
                to_end=bool(command["to_end"]),
                last=_last(command),
            )
        case "stop":
            session.stop(str(command.get("reason", "asked to")), now_s)
        case "channel":
            reading, timeout_s = _timed(command), float(command["timeout_s"])
            name, unit = str(command["name"]), str(command["unit"])
            session.write(
                lambda writer: writer.channel(reading["t_ns"], name, unit, timeout_s, reading)
            )
        case "state":  # is not resent: there may be too many to remember
            session.write(_message(command).write)
        case "event" | "plan" | "operating_point" as what:
            message = _message(command)
            if what == "operating_point":
                session.step(now_s)  # its ticks first: a file that holds it holds them, too
            session.message(message)
        case "blackbox":
            session.boxes.request(BlackBoxRequest.from_command(command), now_s)
        case "blackbox_event":
            session.boxes.event(checked_event(_timed(command)))
        case unknown:
            raise ValueError(f"there is no command {unknown!r}")


def _first_tick(command: Command) -> int | None:
    first_tick = command.get("first_tick")
    return None if first_tick is None else int(first_tick)


def _newest(command: Command) -> Mark | None:
    newest = command["newest"]
    return None if newest is None else Mark.of(newest)


def _last(command: Command) -> list[RunMessage]:
    """Return the last messages; without those that are none, for which no recording is given up."""
    found = []
    for message in command.get("last", ()):
        with suppress(ValueError, KeyError, TypeError):  # reported when it came alone
            found.append(_message(message))
    return found


def _message(command: Command) -> RunMessage:
    content = _timed(command)
    if command["do"] == "event":
        content = checked_event(content)
    return RunMessage(str(command["do"]), content)


def _timed(command: Command) -> dict[str, Any]:
    """Return the content of a command with its time."""
    t_ns, content = int(command["t_ns"]), command["content"]
    if abs(t_ns) > TIME_MAX_NS:
        raise ValueError("t_ns is no time")
    if not isinstance(content, Mapping):
        raise TypeError("a JSON object is wanted")
    return {**content, "t_ns": t_ns}
