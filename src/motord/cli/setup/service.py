"""`motord service install|uninstall|status`: a bench as a systemd service."""

import os
import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.common_options import AsJson, bench_file
from motord.cli.console import fail, group, print_result

if TYPE_CHECKING:
    from collections.abc import Sequence

    from motord.deployment.files import DeployedFile, Deployment
    from motord.deployment.plan import Commands


app = group("Run a bench as a systemd service: install, remove, look.")

LOG_LINES = 8
DATA_BITRATE = 4_000_000

DryRun = Annotated[bool, typer.Option("--dry-run", help="Show what would be done; change nothing.")]
OfUser = Annotated[bool, typer.Option("--user", help="In this user's own systemd, without root.")]
Root = Annotated[
    Path | None,
    typer.Option(
        "--root", metavar="DIR", help="For the system below DIR: files only, no commands are run."
    ),
]


@app.command()
def install(
    config: Annotated[Path, bench_file("The bench that it runs.")],
    dry_run: DryRun = False,
    user: OfUser = False,
    root: Root = None,
    program: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The motord to start; default: this one.")
    ] = None,
    can_bitrate: Annotated[
        int | None,
        typer.Option(min=10_000, max=1_000_000, help="Bring CAN channels up at boot (bit/s)."),
    ] = None,
    can_data_bitrate: Annotated[
        int | None,
        typer.Option(
            min=10_000,
            max=8_000_000,
            help=f"Bit rate of CAN FD's data, by default {DATA_BITRATE}.",
        ),
    ] = None,
    no_start: Annotated[
        bool, typer.Option("--no-start", help="Do not start it now, but at the next boot.")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files that were edited; keep them as .old.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Install unit, udev rules, user and bench file, and start it: OFF until someone enables."""
    from motord.deployment import host
    from motord.deployment.plan import ServiceRequest, activation, files_of, this_program

    start = (str(program.absolute()),) if program else this_program()
    if can_data_bitrate is not None and can_bitrate is None:
        raise typer.BadParameter("--can-data-bitrate without --can-bitrate")
    rates = (can_bitrate, can_data_bitrate or DATA_BITRATE) if can_bitrate else None
    request = ServiceRequest(str(config.absolute()), start, user, rates)
    files, deployment = files_of(request), _deployment(user, root)
    commands = () if root else activation(request, now=not no_start)
    obstacles = _obstacles(user, root, check_program=program is None, config=config)
    if dry_run:
        result = described(deployment, files, commands, obstacles)
        print_result(result, dry_run_text(deployment, files, commands, obstacles), as_json)
        return
    if obstacles:
        fail(obstacles[0])
    written = deployment.write(files, asdict(request), force=force)
    lines = [f"wrote {deployment.place(path)}" for path in written] or ["every file was there"]
    lines += host.carry_out(commands)
    lines += _next_steps(user, root, changed=bool(written))
    result = {"written": list(map(str, written)), "ran": list(map(shlex.join, commands))}
    print_result(result, "\n".join(lines), as_json)


def _next_steps(user: bool, root: Path | None, *, changed: bool) -> list[str]:
    if root:
        return [f"enable it there: systemctl --root {shlex.quote(str(root))} enable motord"]
    steps = []
    if changed:
        whose = " --user" if user else ""
        steps.append(
            f"one that was running goes on as it was: systemctl{whose} restart motord, when the "
            "bench is OFF"
        )
    if user:
        steps.append("it runs while you are logged in; from boot on: loginctl enable-linger")
    return steps


@app.command()
def uninstall(
    dry_run: DryRun = False, user: OfUser = False, root: Root = None, as_json: AsJson = False
) -> None:
    """Stop it and remove what install wrote; recordings, calibrations and bench file stay."""
    from motord.deployment import host
    from motord.deployment.plan import after_removal, before_removal

    deployment = _deployment(user, root)
    if deployment.request is None:
        fail("there is no service that `motord service install` made" + ("" if user else "; "
             "is it one of --user?"))  # fmt: skip
    before = () if root else before_removal(user=user)
    after = () if root else after_removal(user=user)
    verb = "remove" if dry_run else "removed"
    if dry_run:
        removed, left = deployment.removable()
        first, last = ([f"run {shlex.join(args)}" for args in part] for part in (before, after))
    else:
        if obstacles := _obstacles(user, root):
            fail(obstacles[0])
        first = host.carry_out(before, may_fail=True)
        removed, left = deployment.remove()
        last = host.carry_out(after)
    lines = [*first, *(f"{verb} {deployment.place(path)}" for path in removed)]
    lines += [*(f"left {deployment.place(path)}: it was edited" for path in left), *last]
    lines += [] if user else ["bench file, recordings, calibrations and the user motord stay"]
    result = {"removed": list(map(str, removed)), "left": list(map(str, left))}
    print_result(result, "\n".join(lines), as_json)


@app.command()
def status(user: OfUser = False, root: Root = None, as_json: AsJson = False) -> None:
    """Show the unit, its limits and newest log lines, and which files differ from this motord's."""
    from motord.deployment import host

    deployment = _deployment(user, root)
    unit = {} if root else host.unit_state(user=user)
    pid = int(unit.get("MainPID") or 0)
    files, wrong = _differences(deployment)
    result = {
        "unit": unit,
        "limits": host.limits_of(pid) if pid else {},
        "files": files,
        "log": [] if root else host.recent_lines(LOG_LINES, user=user),
    }
    print_result(result, "\n".join(status_lines(result, ask_systemd=root is None)), as_json)
    if wrong:
        fail(wrong)


def _deployment(user: bool, root: Path | None) -> "Deployment":
    from motord.deployment.files import Deployment
    from motord.deployment.plan import manifest

    if user and root:
        raise typer.BadParameter("--user and --root do not go together")
    return Deployment(manifest(user=user), root.absolute() if root else Path("/"))


def _obstacles(
    user: bool, root: Path | None, *, check_program: bool = False, config: Path | None = None
) -> list[str]:
    """Return what is in the way of changing this computer, each with the remedy."""
    from motord.deployment.host import is_systemd
    from motord.deployment.plan import hidden_parts, this_program

    if root:
        return []
    found = []
    again = [arg if arg != str(config) else str(Path(arg).absolute()) for arg in sys.argv[1:]]
    if not user and os.geteuid() != 0:
        whole = shlex.join([*this_program(), *again])
        found.append(f"a service of the system takes root: sudo {whole}; without: --user")
    if not is_systemd():
        found.append(
            "systemd does not run this computer: `motord run -c FILE` runs a bench in the "
            "foreground, --root DIR writes the files for another system"
        )
    if not user and check_program and (hidden := hidden_parts()):
        found.append(
            f"this motord needs {', '.join(hidden)}, in somebody's home, which a service of the "
            "system cannot see. Install one for all: python3 -m venv /opt/motord && "
            "/opt/motord/bin/pip install motord, then /opt/motord/bin/motord "
            f"{shlex.join(again)}; or --user"
        )
    return found


def _differences(deployment: "Deployment") -> tuple[dict[str, str] | None, str]:
    """Return how the files that are there differ from those that would be installed now.

    None, and why, if that cannot be known: the bench file was edited and is wrong.
    """
    from motord.config import ConfigError
    from motord.deployment.files import DeploymentError
    from motord.deployment.plan import BENCH, ServiceRequest, files_of

    asked = deployment.request
    if asked is None:
        return {}, ""
    rates = tuple(asked["can_bitrates"]) if asked["can_bitrates"] else None
    bench = asked["bench_file"] if asked["user"] else str(deployment.place(BENCH))
    request = ServiceRequest(bench, tuple(asked["program"]), asked["user"], rates)
    try:
        files = [file for file in files_of(request) if not file.kept]
    except (ConfigError, DeploymentError) as error:
        return None, str(error)
    return {str(file.path): deployment.difference(file) for file in files}, ""


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
    unit, limits = result["unit"], result["limits"]
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
    for path, difference in (result["files"] or {}).items():
        lines.append(f"file     {path}: {_DIFFERENCES[difference]}")
    if result["files"] == {}:
        lines.append("file     none that `motord service install` wrote")
    if unit.get("NeedDaemonReload") == "yes":
        lines.append("         changed on disk: systemctl daemon-reload")
    return lines + [f"log      {line}" for line in result["log"]]
