"""The pages of docs/how-to, followed step by step."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT, Block, blocks

DRIVER = "docs/how-to/add-a-driver.md"
TIMEOUT_S = 300.0


def blocks_of(page: str, language: str) -> list[Block]:
    return [block for block in blocks() if (block.file, block.language) == (page, language)]


def run(*arguments: str, path: Path, **variables: str) -> str:
    """Run Python with `path` before everything else; return what it prints."""
    environment = dict(os.environ, PYTHONPATH=f"{path}:{ROOT / 'src'}:{ROOT}", **variables)
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=environment, check=False,
        capture_output=True, text=True, timeout=TIMEOUT_S,
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
from motord.config import BridgeConfig, InverterConfig
from motord.hal.registry import known, make_rig
bench = config.load().model_copy(update={
    "inverter": InverterConfig(driver="acme"),
    "bridge": BridgeConfig(driver="serial", port="/dev/null"),
})
print(known("inverter"), type(make_rig(bench)._inverter).__module__)
"""


def test_a_driver_is_found_by_its_entry_point(acme: Path) -> None:
    assert run("-c", FIND, path=acme) == "['acme', 'can', 'can-dq', 'sim'] acme_motord\n"


@pytest.mark.system
def test_a_driver_keeps_the_contract(acme: Path) -> None:
    [block] = blocks_of(DRIVER, "sh")
    words = block.text.split()[2:]  # the folder and the program are those of this test
    out = run("-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *words, path=acme)
    passed = re.search(r"(\d+) passed, 1 skipped", out)
    assert passed, out
    assert int(passed[1]) > 25
