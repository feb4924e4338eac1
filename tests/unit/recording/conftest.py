"""Recordings that several modules read."""

from pathlib import Path

import pytest

from tests.unit.recording.runs import CHUNK_S, COUNT, write_run


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "run.mcap"


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    write_run(path, COUNT, chunk_s=CHUNK_S)
    return path
