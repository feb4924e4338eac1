"""Fixtures of the daemon."""

import pytest

from tests.unit.service.played_daemon import PlayedDaemon


@pytest.fixture
def played(tmp_path, monkeypatch):
    daemon = PlayedDaemon(tmp_path, monkeypatch)
    yield daemon
    daemon.close()
