"""Arguments that a compiled function finds by their address; the cache of compiled functions."""

import ast
import enum
import errno
import gc
import importlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FunctionType, SimpleNamespace
from typing import IO, Any

import numba
import numpy as np
import pytest

import motord
from motord import jit
from motord.jit import ArgumentBlock, jit_holding_gil, records_at
from motord.kernel_cache import claim, kernel_cache, kernel_sources, usable_kernel_cache
from motord.schema import record_dtype

PAIR = record_dtype([("x", "f8"), ("n", "i4")])


@jit_holding_gil
def add_up(frame: int, count: int) -> float:
    """Sum array 0, note sum and count in the record that is array 1."""
    total = 0.0
    values = records_at(frame, 0, count, np.float64)
    for i in range(count):
        total += values[i]
    pair = records_at(frame, 1, 1, PAIR)[0]
    pair.x, pair.n = total, count
    return total


@jit.jit
def reversed_copy(values: np.ndarray) -> np.ndarray:
    """Return a new array, of numba's allocator."""
    turned = np.empty_like(values)
    for i in range(values.size):
        turned[values.size - 1 - i] = values[i]
    return turned


def add_one(value: float) -> float:
    """Return one more."""
    return value + 1.0


@pytest.mark.kernel
def test_a_compiled_function_reads_and_writes_through_a_frame() -> None:
    values, pair = np.arange(5.0), np.zeros(1, PAIR)
    frame = ArgumentBlock(values, pair)
    assert add_up(frame.address, 5) == 10.0
    assert (pair[0].x, pair[0].n) == (10.0, 5)
    frame.replace(0, values + 1.0)  # nothing else refers to the sum of the two
    gc.collect()
    assert add_up(frame.address, 5) == 15.0


def test_a_frame_keeps_its_arrays() -> None:
    frame = ArgumentBlock(np.full(1000, 2.0), np.zeros(1, PAIR))
    gc.collect()
    assert add_up(frame.address, 1000) == 2000.0


def test_what_would_be_read_wrongly_is_refused() -> None:
    values, pair = np.arange(5.0), np.zeros(1, PAIR)
    frame = ArgumentBlock(values, pair)
    with pytest.raises(ValueError, match="argument 0 is float64"):
        frame.replace(0, np.arange(4.0))
    with pytest.raises(ValueError, match="argument 1"):
        frame.replace(1, np.zeros(1))
    with pytest.raises(ValueError, match="contiguous"):
        ArgumentBlock(np.arange(10.0)[::2])


PACKAGE = Path(motord.__file__).parent


def modules_with_kernels() -> list[Path]:
    return [path for path in PACKAGE.rglob("*.py") if "from motord.jit import" in path.read_text()]


def compiled_in(source: Path) -> Iterator[str]:
    """Yield the modules of motord whose constants or kernels those of `source` may use."""
    for node in ast.walk(ast.parse(source.read_text())):
        if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("motord."):
            continue
        module = importlib.import_module(node.module)
        for name in (alias.name for alias in node.names):
            value = getattr(module, name, None)  # None: a module of this package
            is_enum = isinstance(value, type) and issubclass(value, enum.Enum)
            if hasattr(value, "py_func") or is_enum:
                yield value.__module__
            elif isinstance(value, int | float | complex | str | bytes | tuple | np.dtype):
                yield node.module


def test_the_cache_knows_every_source_of_a_kernel() -> None:
    known = set(kernel_sources(PACKAGE))
    assert len(modules_with_kernels()) > 30
    for source in modules_with_kernels():
        assert source in known
        for name in compiled_in(source):
            path = Path(importlib.import_module(name).__file__ or "")
            assert path in known, f"{source.name} has something of {path.name} compiled in"


def test_an_edit_anywhere_below_a_folder_of_kernels_starts_a_new_cache(tmp_path: Path) -> None:
    copy = tmp_path / "motord"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    before = kernel_cache(copy)
    below = copy / "identification" / "room"
    below.mkdir()
    (below / "kernel.py").write_text("GAIN = 1.0\n")
    made = kernel_cache(copy)
    (below / "kernel.py").write_text("GAIN = 1.5\n")
    assert len({before, made, kernel_cache(copy)}) == 3


def test_processes_without_a_kernel_do_not_load_the_compiler() -> None:
    """It takes half a second of every start, and sixty megabytes for as long as they run."""
    modules = "daemon", "gateway.process"
    lines = [f"import motord.service.{name}" for name in modules]
    lines += ["import motord.recorder.main, motord.client, motord.cli.console", "import sys"]
    lines += ["motord.cli.console.explain_first_run()"]  # as `motord run` begins
    code = "\n".join([*lines, "assert 'numba' not in sys.modules"])
    subprocess.run([sys.executable, "-c", code], check=True)


def test_numba_loads_no_package_and_no_settings_that_kept_kernels_do_not_need(
    tmp_path: Path,
) -> None:
    """A fiftieth of a second of every start; and numba said to install what reads the settings in
    the working folder, at its import and at each compilation."""
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: true\n")
    code = "import sys, motord.jit\nprint({'yaml', 'colorama', 'scipy'} & sys.modules.keys())\n"
    code += "from numba.core import config\n"
    code += "config.reload_config()\nprint(bool(config.DISABLE_JIT))"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=os.environ)
    assert (done.stdout, done.stderr) == ("set()\nFalse\n", "")


def use_kernels() -> None:
    frame = ArgumentBlock(np.ones(3), np.zeros(1, PAIR))
    assert add_up(frame.address, 3) == 3.0
    assert reversed_copy(np.arange(3.0)).tolist() == [2.0, 1.0, 0.0]


def test_kept_kernels_run_without_what_numba_compiles_with() -> None:
    """It takes a third of a second of every start of a loop, a worker or an analysis."""
    use_kernels()  # which are kept from now on
    code = """
import sys
from tests.unit.test_jit import use_kernels

use_kernels()
print("numba.np.linalg" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


@pytest.fixture
def new_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder without kernels, for which processes wait."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(jit._KernelCache, "_waits", True)
    return tmp_path


def can_be_claimed(path: Path) -> bool:
    file = claim(path)
    if file is not None:
        file.close()
    return file is not None


def test_what_another_process_compiled_meanwhile_is_taken(
    monkeypatch: pytest.MonkeyPatch, new_cache: Path
) -> None:
    kernel: Any = jit.jit
    here, there = kernel(add_one), kernel(add_one)

    def claimed(path: Path) -> None:
        """Wait until the other process has compiled it."""
        monkeypatch.setattr(jit, "claim", claim)
        assert there(1.0) == 2.0

    monkeypatch.setattr(jit, "claim", claimed)
    assert here(1.0) == 2.0
    assert (here.stats.cache_hits.total(), here.stats.cache_misses.total()) == (1, 0)
    assert (there.stats.cache_hits.total(), there.stats.cache_misses.total()) == (0, 1)
    assert can_be_claimed(next(new_cache.rglob("*.lock")))


@pytest.mark.usefixtures("new_cache")
def test_python_without_docstrings_has_the_same_kernels() -> None:
    """They were compiled once more for `python -OO`, which drops docstrings and assertions."""
    module = compile(Path(__file__).read_text(), __file__, "exec", optimize=2)
    codes = (code for code in module.co_consts if isinstance(code, CodeType))
    code = next(code for code in codes if code.co_name == "add_one")
    kernel: Any = jit.jit
    here, there = kernel(add_one), kernel(FunctionType(code, globals()))
    assert here(1.0) == there(1.0) == 2.0
    assert (there.stats.cache_hits.total(), there.stats.cache_misses.total()) == (1, 0)


@pytest.mark.usefixtures("new_cache")
def test_a_kernel_that_could_not_be_compiled_waits_not_for_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    claimed: list[Path] = []

    def counted(path: Path) -> IO[bytes] | None:
        claimed.append(path)
        return claim(path)

    monkeypatch.setattr(jit, "claim", counted)
    kernel: Any = jit.jit(add_one)
    with pytest.raises(numba.TypingError):
        kernel("text")
    assert kernel(1.0) == 2.0
    assert len(claimed) == 1
    assert can_be_claimed(claimed[0])


@pytest.mark.usefixtures("new_cache")
def test_who_waited_in_vain_waits_for_no_other_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever is stopped holds a kernel and all that call it: each would cost a minute."""
    in_vain: list[Path] = []
    monkeypatch.setattr(jit, "claim", in_vain.append)
    inner = jit.jit(add_one)

    @jit.jit
    def outer(value: float) -> float:
        return inner(value) + 1.0

    assert outer(1.0) == 3.0
    assert len(in_vain) == 1


def test_a_kernel_is_one_process_at_a_time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = new_lock(tmp_path)
    mine = claim(path)
    assert mine is not None
    with monkeypatch.context() as brief:
        brief.setattr("motord.kernel_cache.COMPILING_S", 0.1)
        assert not can_be_claimed(path)
    mine.close()
    assert can_be_claimed(path)
    assert not can_be_claimed(tmp_path / "nowhere" / "kernel.lock")


def new_lock(cache: Path) -> Path:
    """Return where the lock of a kernel is, in one of two folders of a cache."""
    for folder in (cache / "motord.control", cache / "motord.rig"):
        folder.mkdir()
    return cache / "motord.rig" / "kernel.lock"


@pytest.mark.parametrize("other_ns", [0, 10**18])
def test_as_long_as_kernels_are_kept_they_are_waited_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, other_ns: int
) -> None:
    """On a slow computer those that the tick calls take two minutes before its own turn.

    Also where the clock was ahead when others were kept, as without a battery it may be.
    """
    path, minutes = new_lock(tmp_path), iter(range(1000))
    waited: list[Path] = []
    compiler = claim(path)
    assert compiler is not None

    def look_again(_seconds: float) -> None:
        waited.append(path)
        os.utime(tmp_path / "motord.control", ns=(0, len(waited)))
        if len(waited) == 5:
            compiler.close()

    fake = SimpleNamespace(monotonic=lambda: 61.0 * next(minutes), sleep=look_again)
    monkeypatch.setattr("motord.kernel_cache.time", fake)
    os.utime(tmp_path / "motord.rig", ns=(0, other_ns))
    os.utime(tmp_path / "motord.control", ns=(0, 0))
    assert can_be_claimed(path)
    assert len(waited) == 5


def test_a_cache_that_is_emptied_meanwhile_ends_no_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path, minutes = new_lock(tmp_path), iter(range(1000))
    fake = SimpleNamespace(monotonic=lambda: 61.0 * next(minutes), sleep=lambda _: empty(tmp_path))
    compiler = claim(path)
    assert compiler is not None
    monkeypatch.setattr("motord.kernel_cache.time", fake)
    assert not can_be_claimed(path)
    compiler.close()


def empty(folder: Path) -> None:
    for one in folder.iterdir():
        shutil.rmtree(one)


def test_an_installation_elsewhere_has_the_same_kernels(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kernel: Any = records_at
    here, stamp = kernel._cache.cache_path, kernel._cache._impl.locator.get_source_stamp()
    monkeypatch.setattr(jit, "PACKAGE", tmp_path)
    module = tmp_path / "jit.py"
    shutil.copyfile(jit.__file__, module)
    place = jit._Locator(kernel.py_func, str(module))
    assert place.get_cache_path() == here
    assert place.get_source_stamp() == stamp


def test_a_module_that_was_edited_after_the_folder_was_named_has_other_kernels(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A process that loads it late would keep machine code of the edit for those without it."""
    monkeypatch.setattr(jit, "PACKAGE", tmp_path)
    module = tmp_path / "edited.py"
    module.write_text("GAIN = 1.0\n")
    place = jit._Locator(add_one, str(module))
    before = place.get_source_stamp()
    module.write_text("GAIN = 1.5\n")
    assert place.get_source_stamp() != before


def test_a_cache_that_cannot_be_written_to_says_what_to_do(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "motord", "simulate", "cogging"]
    nowhere = {**os.environ, "MOTORD_CACHE_DIR": "/proc/nowhere"}
    done = subprocess.run(command, capture_output=True, text=True, env=nowhere, cwd=tmp_path)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "/proc/nowhere/motord/kernels-" in done.stderr
    assert "set MOTORD_CACHE_DIR to a folder that this user may write to" in done.stderr


def test_a_cache_that_cannot_be_read_either_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("motord.kernel_cache.kernel_cache", lambda: tmp_path)
    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    for name in ("listdir", "scandir"):
        monkeypatch.setattr(os, name, refuse)
    with pytest.raises(OSError, match="Permission denied; set MOTORD_CACHE_DIR"):
        usable_kernel_cache()


def test_kernels_are_kept_nowhere_else(tmp_path: Path) -> None:
    """Where a folder in the cache is of another user numba went on to that of the source."""
    code = (
        "import motord.jit as jit, pathlib\n"
        "place = pathlib.Path(jit.records_at._cache.cache_path)\n"
        "place.rmdir()\n"
        "place.touch()\n"
        "jit.jit(jit.records_at.py_func)\n"
    )
    changed = {**os.environ, "MOTORD_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env=changed)
    assert done.returncode == 1
    assert "cannot keep compiled kernels there: File exists; set MOTORD_CACHE_DIR" in done.stderr


def test_without_a_home_the_error_says_to_name_a_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in ("MOTORD_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", no_home)
    with pytest.raises(OSError, match="this user has no home; set MOTORD_CACHE_DIR"):
        kernel_cache()


KERNEL = """
import errno, os, sys, tempfile
import numba.core.caching

def refuse(*_, **__):
    raise OSError(int(os.environ["ERRNO"]), "no more")

if os.environ["ERRNO"] == str(errno.EROFS):
    os.access, tempfile.TemporaryFile = lambda *_: False, refuse
saves, save = numba.core.caching.IndexDataCacheFile, numba.core.caching.IndexDataCacheFile.save
saves.save = refuse
from motord.jit import jit
for argument in sys.argv[1:]:
    add = jit(lambda x, y: x + y)
    try:
        print(add(1, eval(argument)), add.stats.cache_hits.total())
    except OSError as error:
        print(error)
    if os.environ["ERRNO"] == str(errno.ENOSPC):
        saves.save = save  # there is room again
"""


def test_kernels_of_a_read_only_folder_are_used_and_what_is_not_kept_is_said(
    tmp_path: Path,
) -> None:
    script = tmp_path / "kernel.py"
    script.write_text(KERNEL)

    def run(error: int, *arguments: str) -> subprocess.CompletedProcess[str]:
        changed = {"MOTORD_CACHE_DIR": str(tmp_path / "cache"), "ERRNO": str(error)}
        command = [sys.executable, str(script), *arguments]
        return subprocess.run(
            command, capture_output=True, text=True, env={**os.environ, **changed}
        )

    assert "cannot keep compiled kernels there: no more" in run(errno.EROFS, "2").stderr
    full, kept = run(errno.ENOSPC, "2", "2").stdout.splitlines()
    assert "cannot keep compiled kernels there: no more; set MOTORD_CACHE_DIR" in full
    assert str(tmp_path / "cache") in full
    assert kept == "3 0"
    used = run(errno.EROFS, "2", "2.5").stdout
    assert used == "3 1\n3.5 0\n"  # the second is compiled, though not kept
