"""The process that workers on this computer are forked from, with what they need imported.

It is the fork server of `multiprocessing`. A spawned worker spends two seconds of processor time on
the same imports; this process does them once, while the command prepares Dask's scheduler. It ends
with the command.
"""

import multiprocessing
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from multiprocessing import forkserver

from motord.batch.error import BatchError

MODULES = "motord.cli", "motord.batch.worker_modules"
"""What every worker needs; `multiprocessing` imports the command's main module, so the first."""

METHOD = "forkserver" if sys.version_info >= (3, 11, 1) else "spawn"
"""How workers begin: other users can have older fork servers run programs (CVE-2022-42919)."""


def start_fork_server(modules: Sequence[str], environment: Mapping[str, str]) -> None:
    """Start the fork server, unless it runs or is not used. What it cannot import workers will.

    modules: imported there besides MODULES. environment: variables set there first, as libraries
    count their threads when they are imported; this process has them from then on, too. Raises
    BatchError where it does not start.
    """
    os.environ.update(environment)
    if METHOD == "spawn":
        return
    multiprocessing.get_context(METHOD).set_forkserver_preload([*MODULES, *modules])
    try:
        forkserver.ensure_running()
    except OSError as error:  # the name of its socket may have about 100 characters
        raise BatchError(
            f"workers cannot be started on this computer: {error}; their socket is in the folder "
            f"for temporary files, {tempfile.gettempdir()}: TMPDIR=/tmp names a shorter one"
        ) from error


def keep_modules() -> None:
    """Keep Dask from choosing the modules itself, for which it imports pandas and others here.

    That takes half a second where they are installed. The name is not public; if Dask has none of
    it any more, the workers start later, and nothing else changes.
    """
    from distributed import utils

    utils._forkserver_preload_set = True
