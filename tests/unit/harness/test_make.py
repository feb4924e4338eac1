"""How `make` installs what motord needs."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("forbidden", ["", "1"])
def test_modules_are_compiled_at_once_where_python_may_not_keep_them_later(
    forbidden: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else each command would compile all that it imports."""
    for name in ("MAKELEVEL", "MAKEFLAGS", "MFLAGS"):  # of the make that runs the tests
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", forbidden)
    command = ["make", "--dry-run", "--always-make", "VENV=venv", "venv/dev.stamp"]
    said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    installs = [line for line in said.splitlines() if " pip " in line]
    assert len(installs) == 3
    assert all(("--no-compile" in line) is not bool(forbidden) for line in installs)
