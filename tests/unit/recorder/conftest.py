"""Fixtures of the recorder's session."""

import pytest

from motord.recording import storage
from tests.unit.recorder.recorder_bench import PLENTY, Bench, FreeSpace


@pytest.fixture
def free_space(monkeypatch: pytest.MonkeyPatch) -> None:
    FreeSpace.bytes = PLENTY
    monkeypatch.setattr(storage, "free_bytes", lambda folder: FreeSpace.bytes)


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)
