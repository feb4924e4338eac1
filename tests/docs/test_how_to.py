"""The pages of docs/how-to, followed step by step."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from motord import schema
from motord.recording.writer import RunWriter
from tests.docs.blocks import ROOT, Block, blocks

DRIVER = "docs/how-to/add-a-driver.md"
INTERLOCK = "docs/how-to/add-an-interlock.md"
FIELD = "docs/how-to/add-a-tick-field.md"
TIMEOUT_S = 300.0
KERNELS = shutil.ignore_patterns("*.nbi", "*.nbc")
"""What the compiler made is not copied: of a kernel it does not know that what it calls changed."""


def blocks_of(page: str, language: str) -> list[Block]:
    return [block for block in blocks() if (block.file, block.language) == (page, language)]


def change(root: Path, diff: str) -> None:
    """Make the changes of a block: `--- FILE`, then hunks after `@@ WHERE`, each found once."""
    for part in re.split(r"^--- ", diff, flags=re.M)[1:]:
        name, *hunks = re.split(r"\n@@ .*\n", part)
        path = root / name
        text = path.read_text()
        for hunk in hunks:
            lines = hunk.rstrip("\n").split("\n")
            before, after = (
                "\n".join(line[1:] for line in lines if not line.startswith(left_out)) + "\n"
                for left_out in "+-"
            )
            assert text.count(before) == 1, f"{name} has not once:\n{before}"
            text = text.replace(before, after)
        path.write_text(text)


def changed(page: str, copy: Path) -> Path:
    """Return a copy of the source in which the changes of a page are made."""
    for folder in ("src", "tests/unit/control", "tools", "docs"):
        shutil.copytree(ROOT / folder, copy / folder, ignore=KERNELS)
    for file in ("README.md", "CONTRIBUTING.md"):
        shutil.copy(ROOT / file, copy / file)
    for block in blocks_of(page, "diff"):
        change(copy, block.text)
    return copy


def run(*arguments: str, path: Path, cwd: Path = ROOT, **variables: str) -> str:
    """Run Python with `path` before everything else; return what it prints."""
    folders = f"{path}:{path / 'src'}:{ROOT / 'src'}:{ROOT}"
    environment = {**os.environ, "PYTHONPATH": folders, **variables}
    environment.pop("MOTORD_NO_SKIPS", None)  # a bench may be unable to provoke something
    done = subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment,
        check=False, capture_output=True, text=True, timeout=TIMEOUT_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def acme(tmp_path: Path) -> Path:
    """The package of the page, as an installation of it leaves it."""
    for block in blocks_of(DRIVER, "python"):
        (tmp_path / block.first.removeprefix("# ")).write_text(block.text)
    [entry] = blocks_of(DRIVER, "toml")
    [[group, drivers]] = tomllib.loads(entry.text)["project"]["entry-points"].items()
    installed = tmp_path / "acme_motord-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-motord\nVersion: 1.0\n")
    lines = [f"[{group}]", *(f"{name} = {target}" for name, target in drivers.items())]
    (installed / "entry_points.txt").write_text("\n".join([*lines, ""]))
    return tmp_path


FIND = """
from motord import config
from motord.config.devices import BridgeConfig, InverterConfig
from motord.hal.registry import known, make_rig
bench = config.load().model_copy(update={
    "inverter": InverterConfig(driver="acme", settings={"host": "drive"}),
    "bridge": BridgeConfig(driver="serial", port="/dev/null"),
})
print(known("inverter"), type(make_rig(bench)._inverter).__module__)
"""


def test_a_driver_is_found_by_its_entry_point(acme: Path) -> None:
    assert run("-c", FIND, path=acme) == "['acme', 'can', 'can-dq', 'sim'] acme_motord\n"


@pytest.mark.system
def test_a_driver_keeps_the_contract(acme: Path) -> None:
    [block] = blocks_of(DRIVER, "sh")
    arguments = block.text.split()[2:]  # the folder and the program are those of this test
    out = run(
        "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *arguments, path=acme
    )
    passed = re.search(r"(\d+) passed, 1 skipped", out)
    assert passed, out
    assert int(passed[1]) > 25


@pytest.mark.system
def test_an_interlock_by_the_page_passes_the_tests_of_interlocks(tmp_path: Path) -> None:
    copy = changed(INTERLOCK, tmp_path)
    folder = copy / "tests/unit/control"
    files = [str(folder / name) for name in ("test_interlocks.py", "test_interlock_table.py")]
    out = run(
        "-m", "pytest", "-q", "-p", "no:xdist", "-k", "not rates", *files, path=copy, cwd=copy,
        NUMBA_DISABLE_JIT="1",
    )  # fmt: skip
    assert " passed" in out


TICK = """
from pathlib import Path
import numpy as np
from tools.reference import __main__ as reference
from motord.config import load
from motord.control import parameters
from motord.control.step import new_memory, step
from motord.control.types import COMMAND, FEEDBACK, SETPOINT
from motord.proto import definitions, write
from motord.schema import TICK, TICK_DTYPE
from motord.dashboard.signals import ROW, values
from motord.recording.errors import RecordError
from motord.recording.reader import Run

memory, tick = new_memory(), np.zeros(1, TICK_DTYPE)
memory["heat_s"] = 1.0, 3.0, 2.0
records = (np.zeros(1, dtype) for dtype in (FEEDBACK, SETPOINT, COMMAND))
step(*parameters.build(load()), memory, *records, tick)
write()
print(TICK.fields[-1].name, TICK.fields[-1].number, 2.9 < tick["i2t_s"][0] <= 3.0)
before = Run(Path("before.mcap"))
print(before.ticks(["tick"]).size)
try:
    before.ticks(["i2t_s"])
except RecordError as error:
    print(error)
print(values(tick)[ROW["i2t_s"], 0] == tick["i2t_s"][0])
print(all("i2t_s" in text for path, text in definitions() if path.name == "tick.proto"))
reference.PAGES = {"recording.md": reference.PAGES["recording.md"]}
reference.main([])
"""


def test_a_field_by_the_page_is_in_tick_proto_docs_and_on_the_live_page(tmp_path: Path) -> None:
    copy = changed(FIELD, tmp_path)
    with RunWriter(copy / "before.mcap", {"bench": "before"}) as writer:
        writer.ticks(np.zeros(3, schema.TICK_DTYPE))
    out = run("-c", TICK, path=copy, cwd=copy, NUMBA_DISABLE_JIT="1")
    field, before, error, drawn, proto, wrote = out.splitlines()
    assert (field, before) == (f"i2t_s {len(schema.TICK.fields) + 1} True", "3")
    assert (drawn, proto) == ("True", "True")
    assert "i2t_s" in error
    assert wrote == "wrote docs/reference/recording.md"
    assert "| `i2t_s` | float | s |" in (copy / "docs/reference/recording.md").read_text()
