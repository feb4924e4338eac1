"""What `motord service` prints: a dry run, and the status."""

import shlex
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from motord.deployment.files import DeployedFile, Deployment
    from motord.deployment.plan import Commands

_DIFFERENCES = {
    "same": "as installed", "new": "missing", "changed": "of another version", "edited": "edited",
}  # fmt: skip


def described(
    deployment: "Deployment", files: "Sequence[DeployedFile]", commands: "Commands",
    obstacles: list[str],
) -> dict[str, Any]:  # fmt: skip
    """Return a dry run as JSON has it."""
    return {
        "files": [
            {"path": str(f.path), "difference": deployment.difference(f), "text": f.text}
            for f in files
        ],
        "commands": list(map(shlex.join, commands)),
        "obstacles": obstacles,
    }


def dry_run_text(
    deployment: "Deployment", files: "Sequence[DeployedFile]", commands: "Commands",
    obstacles: list[str],
) -> str:  # fmt: skip
    """Return what would be written, as differences to what is there, and run."""
    lines = []
    for file in files:
        lines.append(f"{deployment.difference(file)} {deployment.place(file.path)}")
        if diff := deployment.diff(file):
            lines.append(diff)
    lines += [f"run {shlex.join(command)}" for command in commands]
    lines += [f"in the way: {obstacle}" for obstacle in obstacles]
    return "\n".join([*lines, "nothing was changed"])


def status_lines(result: dict[str, Any], *, ask_systemd: bool) -> list[str]:
    """Return the status in lines."""
    unit, limits, files = result["unit"], result["limits"], result["files"]
    lines = []
    if ask_systemd and not unit:
        lines.append("unit     systemd does not answer")
    elif unit.get("LoadState") == "not-found":
        lines.append("unit     not installed")
    elif unit:
        lines.append(
            f"unit     {unit.get('ActiveState')} ({unit.get('SubState')}) since "
            f"{unit.get('ActiveEnterTimestamp') or 'never'}, {unit.get('UnitFileState')}, "
            f"{unit.get('NRestarts')} restarts, result {unit.get('Result')}"
        )
    if limits:
        lines.append(
            f"limits   real-time priority {limits['rt_priority'] or '?'}, locked memory "
            f"{limits['locked_memory_bytes'] or '?'}"
        )
    lines += [f"file     {path}: {_DIFFERENCES[difference]}" for path, difference in files.items()]
    if not files:
        lines.append("file     none that `motord service install` wrote")
    if unit.get("NeedDaemonReload") == "yes":
        lines.append("         changed on disk: systemctl daemon-reload")
    return lines + [f"log      {line}" for line in result["log"]]
