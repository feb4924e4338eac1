"""A Zenoh session that says what a test lets it say; a daemon's own pieces."""

from types import SimpleNamespace

import pytest

from tests.unit.service.live_service import live_service


class Session:
    """Takes one subscriber; `sends` delivers a payload to it."""

    def declare_subscriber(self, key_expr, receive):
        self.key_expr, self.receive, self.declared = key_expr, receive, True
        return SimpleNamespace(undeclare=self.undeclare)

    def undeclare(self):
        self.declared = False

    def sends(self, content):
        payload = SimpleNamespace(to_bytes=lambda: content)
        self.receive(SimpleNamespace(payload=payload, key_expr=self.key_expr))


@pytest.fixture
def session():
    return Session()


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    with live_service(tmp_path_factory.mktemp("state")) as service:
        yield service
