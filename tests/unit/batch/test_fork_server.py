"""What workers are forked from: it has one thread, and they have nothing left to import."""

import multiprocessing
import subprocess
import sys
import tempfile
from multiprocessing import forkserver, process

import pytest

from motord.batch.error import BatchError
from motord.batch.fork_server import METHOD, MODULES, keep_modules, start_fork_server
from motord.batch.task import BatchTask, analyse_recordings
from motord.config import load, packaged
from motord.config.experiments import analysis_kinds
from motord.process.one_thread import ONE_THREAD
from tests.support.short_recordings import ShortRecording

IMPORTED = f"""
import importlib, os, sys, threading
from pathlib import Path
for module in {MODULES!r} + ("motord.experiments.cogging.command",):
    importlib.import_module(module)
before = set(sys.modules)
"""


def test_a_worker_imports_no_other_package_and_no_import_begins_a_thread(
    tmp_path, monkeypatch
) -> None:
    """Its first analysis took a second longer than the next ones."""
    path = ShortRecording.of(load(packaged("sim.toml"))).write(tmp_path / "r.mcap")
    for name, value in ONE_THREAD.items():
        monkeypatch.setenv(name, value)
    analyse_recordings(BatchTask("cogging", {}, {"config": None}), [path])  # its kernels, compiled
    script = """
from motord.batch.task import BatchTask, analyse_recordings
task = BatchTask("cogging", {}, {"config": None})
[outcome] = analyse_recordings(task, [Path(sys.argv[1])]).results
assert not outcome.failure, outcome.failure
print(*(name for name in set(sys.modules) - before if not name.startswith("motord.")))
for module in sys.argv[2:]:
    importlib.import_module(module)
print(threading.active_count())
"""
    modules = sorted({kind.command.partition(":")[0] for kind in analysis_kinds().values()})
    done = subprocess.run(
        [sys.executable, "-c", IMPORTED + script, str(path), *modules],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == "\n1\n"


@pytest.mark.skipif(METHOD != "forkserver", reason="of the fork server alone")
def test_a_folder_whose_name_is_too_long_for_a_socket_is_named(tmp_path, monkeypatch) -> None:
    long = tmp_path / ("t" * 100)
    long.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(long))
    monkeypatch.setitem(process.current_process()._config, "tempdir", None)
    monkeypatch.setattr(forkserver, "_forkserver", forkserver.ForkServer())
    monkeypatch.setattr(forkserver, "ensure_running", forkserver._forkserver.ensure_running)
    with pytest.raises(BatchError, match=r"too long.*t{100}: TMPDIR=/tmp names a shorter one"):
        start_fork_server([], {})


def test_dask_keeps_the_modules(monkeypatch) -> None:
    """Else it imports pandas in the command, and the server has other modules when it restarts."""
    import dask  # 0.4 s with the next, of whoever collects
    from distributed import utils

    chosen = []
    context = multiprocessing.get_context(METHOD)
    monkeypatch.setattr(context, "set_forkserver_preload", chosen.append)
    monkeypatch.setattr(utils, "_forkserver_preload_set", False)
    keep_modules()
    with dask.config.set({"distributed.worker.multiprocessing-method": METHOD}):
        assert utils.get_mp_context() is context
    assert chosen == []
