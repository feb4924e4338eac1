from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from motord.cli.connection_options import Connection
from motord.verdict import recordings
from tests.unit.cli.motor_test.made_up import TYPE, FakeClient
from tests.unit.verdict.made_up import calibration


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pump.toml").write_text(TYPE)
    return tmp_path


@pytest.fixture
def analysed(monkeypatch):
    """Let the analysis of any recordings give a made-up calibration; return what was analysed."""
    seen = SimpleNamespace(runs=[], result=calibration())

    def estimate(given):
        seen.runs.append(given.names)
        return seen.result

    fake = SimpleNamespace(estimate=estimate, to_json=lambda result, _: result)
    monkeypatch.setattr(recordings, "resolve_name", lambda _: fake)
    return seen


@pytest.fixture
def bench(monkeypatch):
    client = FakeClient()

    @contextmanager
    def opened(_self):
        yield client

    @contextmanager
    def in_command(asked, force):
        asked.calls.append("in command")
        yield SimpleNamespace(commander=asked)
        asked.calls.append("lease released")

    monkeypatch.setattr(Connection, "connect", opened)
    monkeypatch.setattr("motord.cli.bench.lease_session.in_command", in_command)
    return client
