"""Command over a bench from the command line.

The first command that needs it takes the lease, writes its token to a private file and renews it
for as long as it runs; commands started meanwhile in other terminals use that token and end at
once. When the one that holds the lease ends, the bench ramps down and is disabled.
"""

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import typer

from motord.cli.console import fail
from motord.runtime.rundir import RunDir, RunDirError

if TYPE_CHECKING:
    from motord.client import Client, Lease

LOOK_S = 0.2


@dataclass(frozen=True)
class Command:
    """The token to command with, and the lease if this process is the one that holds it."""

    token: str
    lease: "Lease | None"


def token_file(bench: str) -> Path:
    """Return where the commands of this user share the token for a bench."""
    return RunDir(f"{bench}@cli").path / "lease.json"


@contextmanager
def in_command(client: "Client", *, force: bool = False) -> Iterator[Command]:
    """Be in command: with the lease that another command holds, else with one of its own."""
    path = token_file(client.bench)
    shared = None if force else _shared_token(client, path)
    if shared is not None:
        yield Command(shared, None)
        return
    with client.lease(force=force) as lease:
        try:
            _write_private(path, lease.token)
            yield Command(lease.token, lease)
        except RunDirError as error:
            fail(str(error))
        finally:
            path.unlink(missing_ok=True)


def _shared_token(client: "Client", path: Path) -> str | None:
    """Return the token of a command that now holds the lease, if it is worth anything."""
    from motord.client import ClientError

    try:
        token = str(json.loads(path.read_text())["token"])
        client.rpc("lease/renew", token=token)
    except (OSError, ValueError, KeyError, TypeError, ClientError):
        return None
    return token


def _write_private(path: Path, token: str) -> None:
    RunDir.at(path.parent).create()  # for this user only
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "w") as file:
        json.dump({"token": token, "pid": os.getpid()}, file)


def hold(client: "Client", lease: "Lease", for_s: float | None, *, quiet: bool) -> None:
    """Stay in command until Ctrl-C, for `for_s`, or until the bench is no longer enabled."""
    if not quiet:
        until = f"for {for_s:g} s" if for_s is not None else "until Ctrl-C"
        typer.echo(f"in command {until}; then the bench ramps down and is disabled", err=True)
    end_s = None if for_s is None else time.monotonic() + for_s
    with suppress(KeyboardInterrupt), _terminated_like_interrupted():
        while end_s is None or time.monotonic() < end_s:
            if lease.lost.wait(LOOK_S if end_s is None else min(LOOK_S, for_s or LOOK_S)):
                fail(f"no longer in command: {lease.why}")
            state = client.state()
            if state.state != "ENABLED":
                why = "; ".join(f"{t.name}: {t.meaning}" for t in state.trips) or state.fault
                fail(f"the bench is {state.state}" + (f": {why}" if why else ""))


@contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """Let SIGTERM end the hold as Ctrl-C does."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
