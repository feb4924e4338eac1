"""A daemon of a simulated bench that the tests of a module share."""

import pytest

from tests.system.daemons import daemon, write_sim


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def running(folder):
    with daemon(folder, write_sim(folder)) as program:
        yield program


@pytest.fixture(scope="module")
def client(running):
    with running.connect() as client:
        yield client
