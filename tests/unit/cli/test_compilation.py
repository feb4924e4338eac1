"""The first run says why it takes longer."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from motord.cli.console import explain_first_run
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
    "arguments",
    [
        ["demo", "--out", "file/out"],
        ["reproduce", "--out", "file/out"],
        ["simulate", "verify", "--set", "turns=x"],
    ],
)
def test_it_is_said_before_kernels_are_imported(tmp_path: Path, arguments: list[str]) -> None:
    (tmp_path / "file").write_text("")
    done = subprocess.run(
        [sys.executable, "-m", "motord", *arguments], cwd=tmp_path, check=False,
        env={**os.environ, "MOTORD_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    first, wrong = done.stderr.splitlines()
    assert first.startswith("first run: compiling the numerical kernels")
    assert wrong.startswith("motord: ")
