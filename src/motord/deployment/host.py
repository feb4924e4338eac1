"""What systemd on this computer does and says."""

import shlex
import subprocess
from pathlib import Path

from motord.deployment.files import DeploymentError
from motord.deployment.plan import UNIT, Commands

RUNNING = Path("/run/systemd/system")
"""There if systemd is the init of this computer (sd_booted(3))."""

SHOWN = (
    "LoadState", "ActiveState", "SubState", "UnitFileState", "Result", "MainPID", "NRestarts",
    "ActiveEnterTimestamp", "NeedDaemonReload",
)  # fmt: skip
LIMITS = {"Max realtime priority": "rt_priority", "Max locked memory": "locked_memory_bytes"}
TIMEOUT_S = 30.0
UDEV_SOCKET = Path("/run/udev/control")
START_TIMEOUT_S = 360.0
"""Enabling starts the unit, whose first start compiles the kernels."""


def is_systemd() -> bool:
    """Return whether systemd runs this computer."""
    return RUNNING.is_dir()


def carry_out(commands: Commands, *, may_fail: bool = False) -> list[str]:
    """Run commands one after the other; return what was done.

    Without udev, as in a container, what is for udev is left out. Raises DeploymentError with what
    the first failing command says.
    """
    steps = []
    for command in commands:
        if command[0] == "udevadm" and not UDEV_SOCKET.exists():
            steps.append(f"left out {shlex.join(command)}: udev does not run")
            continue
        steps.append(f"ran {shlex.join(command)}")
        try:
            done = _run(command, START_TIMEOUT_S)
        except (OSError, subprocess.TimeoutExpired) as error:
            done = subprocess.CompletedProcess(command, 1, "", str(error))
        if done.returncode != 0 and not may_fail:
            why = (done.stderr or done.stdout).strip().replace("\n", "; ")
            raise DeploymentError(
                f"`{' '.join(command)}` failed: {why or f'exit code {done.returncode}'}. What was "
                "written stays; the same command goes on from here"
            )
    return steps


def unit_state(*, user: bool) -> dict[str, str]:
    """Return properties of the unit, empty without systemd."""
    command = ("systemctl", *_user(user), "show", UNIT, f"--property={','.join(SHOWN)}")
    lines = _output(command).splitlines()
    return dict(line.split("=", 1) for line in lines if "=" in line)


def limits_of(pid: int) -> dict[str, str]:
    """Return the real-time limits of a running process, "" for each that cannot be read."""
    try:
        lines = Path(f"/proc/{pid}/limits").read_text().splitlines()
    except OSError:
        lines = []
    found = {label: line.removeprefix(label).split()[0] for line in lines for label in LIMITS
             if line.startswith(label)}  # fmt: skip
    return {name: found.get(label, "") for label, name in LIMITS.items()}


def recent_lines(count: int, *, user: bool) -> list[str]:
    """Return the newest lines of the unit's log."""
    whose = ("--user-unit", UNIT) if user else ("--unit", UNIT)
    log = _output(("journalctl", *whose, f"--lines={count}", "--no-pager", "--output=short-iso"))
    return [line for line in log.splitlines() if not line.startswith("-- ")]


def _user(user: bool) -> tuple[str, ...]:
    return ("--user",) if user else ()


def _output(command: tuple[str, ...]) -> str:
    try:
        return _run(command, TIMEOUT_S).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ""


def _run(command: tuple[str, ...], timeout_s: float) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command, capture_output=True, text=True, timeout=timeout_s, stdin=subprocess.DEVNULL,
        check=False,
    )  # fmt: skip
