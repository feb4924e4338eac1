"""`motord run`: the daemon, in the foreground."""

import os
from typing import TYPE_CHECKING

from motord.cli.common_options import BenchFile, ReadyAsJson
from motord.cli.connection_options import print_answer
from motord.cli.console import explain_first_run, remark
from motord.process.collector_pause import collector_paused

if TYPE_CHECKING:
    from motord.config import Config


def run(
    config: BenchFile = None,
    as_json: ReadyAsJson = False,
) -> None:
    """Run a bench until SIGTERM or Ctrl-C; it starts OFF and ends ramped down and disabled."""
    with collector_paused():
        from motord.config import packaged
        from motord.service.daemon import run as run_daemon

    def say_ready(bench: "Config") -> None:
        ready = {"bench": bench.bench.name, "listen": list(bench.zenoh.listen), "pid": os.getpid()}
        where = ", ".join(bench.zenoh.listen)
        print_answer(ready, f"ready: bench {bench.bench.name} at {where}", as_json)

    if config is None and not as_json:
        remark("no bench file (-c FILE): this is the packaged simulated bench")
    explain_first_run(silent=as_json)
    run_daemon(config or packaged("sim.toml"), say_ready)
