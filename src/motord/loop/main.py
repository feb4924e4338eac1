"""Entry of the loop process: `python -m motord.loop.main --config FILE --dir RUNDIR`.

Numerical libraries start their thread pools when they are loaded, so this module
limits them before it loads any.
"""

import argparse
import os
import sys
from pathlib import Path

from motord.process.collector_pause import collector_paused
from motord.process.one_thread import ONE_THREAD


def main(arguments: list[str] | None = None) -> int:
    """Run the loop process; returns its exit code."""
    parser = argparse.ArgumentParser(prog="motord.loop.main", description="the real-time loop")
    parser.add_argument("--config", type=Path, required=True, help="bench file")
    parser.add_argument("--dir", type=Path, required=True, help="run folder made by the daemon")
    options = parser.parse_args(arguments)
    os.environ.update(ONE_THREAD)
    with collector_paused():
        from motord.loop.process import LoopProcess
        from motord.shm.run_directory import RunDir

    return LoopProcess(options.config, RunDir.at(options.dir)).run()


if __name__ == "__main__":
    sys.exit(main())
