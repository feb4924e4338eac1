"""Fixtures of the daemon."""

import pytest

from motord.shm.ring import RingWriter
from motord.shm.run_directory import RunDir
from tests.unit.service.played_daemon import PlayedDaemon


@pytest.fixture
def played(tmp_path, monkeypatch):
    daemon = PlayedDaemon(tmp_path, monkeypatch)
    yield daemon
    daemon.close()


@pytest.fixture
def run_dir(tmp_path):
    made = RunDir("bench", tmp_path)
    made.create()
    return made


@pytest.fixture
def ring(run_dir):
    return RingWriter(run_dir.ring, 64)
