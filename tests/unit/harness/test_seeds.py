"""Hypothesis draws the same examples whatever was imported before."""

import importlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.conftest import SOAK


def drawn() -> list[int]:
    seen: list[int] = []

    @settings(max_examples=300)
    @given(st.integers(0, 2**62))
    def collect(number: int) -> None:
        seen.append(number)

    collect()
    return seen


@pytest.mark.skipif(SOAK, reason="draws by chance there")
def test_examples_do_not_depend_on_loaded_modules(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = drawn()
    numbers = ", ".join(str(10**12 + 7919 * n) for n in range(1000))
    (tmp_path / "full_of_numbers.py").write_text(f"NUMBERS = [{numbers}]\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("full_of_numbers")
    assert drawn() == before
