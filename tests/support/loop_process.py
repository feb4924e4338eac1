"""A loop process without a supervisor."""

import subprocess
from pathlib import Path

from motord.loop.launch import loop_command
from motord.shm.run_directory import RunDir


def start_loop(config_path: Path, run_dir: RunDir) -> "subprocess.Popen[bytes]":
    """Start the loop process; its status file appears in `run_dir` (`LoopStatus.read`).

    Set-point mailbox and tables must be there. A status left by an earlier loop is removed.
    """
    run_dir.loop_status.unlink(missing_ok=True)
    return subprocess.Popen(loop_command(config_path, run_dir), stdin=subprocess.DEVNULL)
