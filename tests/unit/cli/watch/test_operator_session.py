"""The lease of the screen."""

import pytest

from motord.cli.bench.shared_token import shared, tokens
from motord.cli.bench.watch import operator_session
from motord.cli.bench.watch.operator_session import OperatorSession
from motord.client import ClientError, Commander
from tests.unit.cli.watch.samples import FakeClient


@pytest.fixture(autouse=True)
def private(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.fixture
def client():
    return FakeClient()


def test_another_command_of_this_user_that_holds_the_lease_lends_its_token(client):
    client.replies["lease/renew"] = {"lease_s": 2.0, "renew_within_s": 1.0}
    with shared(client.bench, "theirs"):
        OperatorSession(client).command(Commander.enable, keep=True)
    assert client.asked("enable") == [{"token": "theirs"}]
    assert not client.asked("lease/acquire")


def test_what_is_held_here_is_lent_to_other_commands(client):
    session = OperatorSession(client)
    session.take(force=False)
    assert tokens(client.bench) == ["t0"]
    session.command(Commander.enable)
    session.give()
    assert tokens(client.bench) == []
    assert [name for name, _ in client.requests] == ["lease/acquire", "enable", "lease/release"]


def test_a_command_that_is_refused_leaves_no_lease(client):
    with pytest.raises(ClientError, match="no set now"):
        OperatorSession(client).command(lambda who: who.set(torque_Nm=1.0), keep=True)
    assert len(client.asked("lease/release")) == 1


def test_a_screen_that_hangs_is_not_alive(client, monkeypatch):
    now_s = 100.0
    monkeypatch.setattr(operator_session.time, "monotonic", lambda: now_s)
    session = OperatorSession(client)
    assert session._alive()
    now_s += operator_session.HUNG_S + 0.01
    assert not session._alive()
    session.beat()
    assert session._alive()
