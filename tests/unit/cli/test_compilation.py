"""The first run says why it takes longer."""

from pathlib import Path

import numba
import pytest

from motord.cli.console import explain_first_run


def test_it_is_said_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cache = tmp_path / "kernels"
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(cache))
    explain_first_run(silent=True)
    assert capsys.readouterr().err == ""
    explain_first_run()
    assert capsys.readouterr().err.startswith("first run: compiling the numerical kernels")
    cache.mkdir()
    explain_first_run()
    assert capsys.readouterr().err == ""
