"""Entry of the loop process: `python -m motord.loop.main --config FILE --dir RUNDIR`.

Numerical libraries start their thread pools when they are loaded, so this module
limits them before it loads any.
"""

import os
import sys

from motord.process.bench_options import bench_options
from motord.process.collector_pause import collector_paused
from motord.process.one_thread import ONE_THREAD


def main(arguments: list[str] | None = None) -> int:
    """Run the loop process; returns its exit code."""
    options = bench_options("loop").parse_args(arguments)
    os.environ.update(ONE_THREAD)
    with collector_paused():
        from motord.loop.process import LoopProcess
        from motord.shm.run_directory import RunDir

    return LoopProcess(options.config, RunDir.at(options.dir)).run()


if __name__ == "__main__":
    sys.exit(main())
