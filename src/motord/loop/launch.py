"""How the supervisor starts the loop process."""

import sys
from pathlib import Path

from motord.shm.run_directory import RunDir


def loop_command(config_path: Path, run_dir: RunDir) -> list[str]:
    """Return the command line of the loop process."""
    return [
        *(sys.executable, "-m", "motord.loop.main"),
        *("--config", str(config_path)),
        *("--dir", str(run_dir.path)),
    ]
