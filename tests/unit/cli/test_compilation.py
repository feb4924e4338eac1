"""The first run says why it takes longer."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from motord.cli.console import explain_first_run
from motord.cli.reproduce import demo, reproduce
from motord.kernel_cache import kernel_cache
from tests.support.patience import PATIENCE_S


def test_it_is_said_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MOTORD_CACHE_DIR", str(tmp_path))
    explain_first_run(silent=True)
    assert capsys.readouterr().err == ""
    explain_first_run()
    assert capsys.readouterr().err.startswith("first run: compiling the numerical kernels")
    kernel_cache().mkdir(parents=True)
    explain_first_run()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("command", "first_import"),
    [(demo, "motord.reproduce.demo"), (reproduce, "motord.reproduce.page")],
)
def test_it_is_said_before_the_imports(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: Callable[..., None],
    first_import: str,
) -> None:
    monkeypatch.setenv("MOTORD_CACHE_DIR", str(tmp_path))
    monkeypatch.setitem(sys.modules, first_import, None)
    with pytest.raises(ImportError, match=first_import):
        command(out=tmp_path / "out")
    assert capsys.readouterr().err.startswith("first run: compiling the numerical kernels")


def test_it_is_said_before_kernels_are_imported(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "motord", "simulate", "verify", "--set", "turns=x"],
        cwd=tmp_path, check=False, env={**os.environ, "MOTORD_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    first, wrong = done.stderr.splitlines()
    assert first.startswith("first run: compiling the numerical kernels")
    assert wrong.startswith("motord: ")
