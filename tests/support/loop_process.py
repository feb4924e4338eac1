"""A loop process without a supervisor."""

import subprocess
from pathlib import Path

from motord.shm.run_directory import RunDir


def start_loop(config_path: Path, run_dir: RunDir) -> "subprocess.Popen[bytes]":
    """Start the loop process; its status file appears in `run_dir` (`LoopStatus.read`).

    Set-point mailbox and tables must be there. A status left by an earlier loop is removed.
    """
    run_dir.loop_status.unlink(missing_ok=True)
    command = run_dir.command("motord.loop.main", config_path)
    return subprocess.Popen(command, stdin=subprocess.DEVNULL)
