"""What the supervisor asks of the recorder for a black box; loads nothing that writes one."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from motord.config import Config
from motord.recording.file_names import stamp

BEFORE_S = 10.0
"""Ticks before the trip that a box holds, as far as the ring reaches (`[loop] ring_s`)."""
AFTER_S = 1.0


def path_of(config: Config, t_ns: int) -> Path:
    """Return the name of the black box of a trip at `t_ns` (Unix ns)."""
    folder = config.recording.blackbox_directory.absolute()
    return folder / f"blackbox-{config.bench.name}-{stamp(t_ns)}.mcap"


@dataclass(frozen=True)
class BlackBoxRequest:
    """What a box should be: file, tick of the trip (None: the newest), ticks before and after.

    account: what is known of the trip, with `reason` as text. events: as in a recording, each
    with `t_ns`, `kind`, `message`, `data`; more may be added while the box is open.
    """

    path: Path
    tick: int | None
    ticks_before: int
    ticks_after: int
    metadata: Mapping[str, Any]
    account: Mapping[str, Any]
    events: list[Mapping[str, Any]] = field(default_factory=list)

    @classmethod
    def from_command(cls, command: Mapping[str, Any]) -> "BlackBoxRequest":
        """Return the request in a command. Raises KeyError, TypeError, ValueError."""
        tick = command["tick"]
        return cls(
            path=Path(command["path"]),
            tick=None if tick is None else int(tick),
            ticks_before=int(command["ticks_before"]),
            ticks_after=int(command["ticks_after"]),
            metadata=dict(command["metadata"]),
            account=dict(command["account"]),
            events=[checked_event(event) for event in command["events"]],
        )


def checked_event(event: Mapping[str, Any]) -> dict[str, Any]:
    """Return an event with what a recording needs of it. Raises KeyError, TypeError, ValueError."""
    return {
        "t_ns": int(event["t_ns"]),
        "kind": str(event["kind"]),
        "message": str(event["message"]),
        "data": dict(event.get("data", {})),
    }
