"""What child processes that only report have in common: options, priority, stdout."""

import os
import sys
from collections.abc import Callable

from motord.calibration import CalibrationError
from motord.config import Config, ConfigError, load_started
from motord.process.bench_options import bench_options
from motord.process.ending_threads import NoThreadError
from motord.process.left_threads import end_with_any_thread
from motord.recorder.pipe_lines import LINE_MAX_BYTES, LineWriter
from motord.service.host import scheduling
from motord.shm.run_directory import RunDir
from motord.shm.shared_records import SharedFileError

Serve = Callable[[Config, RunDir, LineWriter], None]
"""Works until stdin ends; reports go to the writer."""


def run(
    name: str,
    serve: Serve,
    schedule: Callable[[int | None], None] = scheduling.lower_priority,
    *,
    blocking: bool = True,
) -> int:
    """Run `serve`, by default at a low priority; return the exit code.

    The command line is --config FILE --dir RUNDIR. `schedule`: sets the process' priority, given
    the loop's processor. `blocking`: whether a report waits for a supervisor that does not read;
    else `serve` has to flush the writer.
    """
    options = bench_options(name).parse_args()
    end_with_any_thread()
    try:
        run_dir = RunDir.at(options.dir)
        config, _ = load_started(options.config, run_dir.bench_file)
        schedule(config.loop.cpu)
        out = os.dup(sys.stdout.fileno())
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what else is printed is no report
        os.set_blocking(out, blocking)
        serve(config, run_dir, LineWriter(out, LINE_MAX_BYTES))
    except (CalibrationError, ConfigError, NoThreadError, SharedFileError) as error:
        sys.stderr.write(f"motord {name}: {error}\n")
        return 1
    return 0
