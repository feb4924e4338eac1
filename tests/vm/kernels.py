"""motord's kernels compiled for the machine's processor, here, where it takes a tenth of the time.

A run of the emulated bench compiles all that a run in the machine wants; the machine finds it in
the same cache, which is not that of this computer's own processor.
"""

import os
import shutil
from pathlib import Path

import numba

import motord.jit  # noqa: F401 - it names the cache
from tests.system.daemons import daemon, emulator, patient
from tests.unit.emulate.benches import write_bench
from tests.vm.kernel import CACHE

FOLDER = CACHE / "kernels"
ENVIRONMENT = {
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "MOTORD_CACHE_DIR": str(FOLDER),
}


def prepare(scratch: Path) -> None:
    """Compile what is not compiled yet; forget what older sources left."""
    current = Path(numba.config.CACHE_DIR).name
    for old in (FOLDER / "motord").glob("kernels-*"):
        if old.name != current:
            shutil.rmtree(old, ignore_errors=True)
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    try:
        bench = write_bench(scratch)
        bench.write_text(patient(bench.read_text(), "prepare"))
        with emulator(scratch, bench, scratch / "truth.mcap"), daemon(scratch, bench) as running:
            assert running.end() == 0, running.said()
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
