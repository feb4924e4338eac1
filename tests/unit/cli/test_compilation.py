"""The first run says why it takes longer."""

from pathlib import Path

import pytest

from motord.cli.console import explain_first_run
from motord.kernel_cache import kernel_cache


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
