"""The daemon on a Unix socket: reached by the members of a group and by nobody else."""

import errno
import os
import shutil
import socket
import stat
import tempfile
from pathlib import Path

import pytest

from motord import config
from motord.api.endpoints import UNIX_SOCKET
from motord.client import ClientError, connect
from motord.client.discovery import why_no_socket
from motord.config import ConfigError
from motord.service.publish.zenoh_api import ApiError
from tests.unit.service.live_service import LiveService, live_service

NOBODY, GROUP, OTHER_GROUP = 65534, 54321, 54322


@pytest.fixture
def folder():
    """A folder that others may enter, as /run/motord is for the group."""
    path = Path(tempfile.mkdtemp(prefix="motord-socket-"))
    path.chmod(0o755)
    yield path
    shutil.rmtree(path)


@pytest.fixture
def where(folder):
    return f"{UNIX_SOCKET}{folder}/bench.sock"


def load(tmp_path, zenoh):
    path = tmp_path / "bench.toml"
    text = config.packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    path.write_text(f"{text}\n[zenoh]\n{zenoh}\n")
    return config.load(path).zenoh


def test_a_bench_file_may_ask_for_it(tmp_path):
    asked = 'listen = ["unixsock-stream//run/motord/bench.sock"]\nsocket_group = "motord"'
    zenoh = load(tmp_path, asked)
    assert zenoh.local == ("unixsock-stream//run/motord/bench.sock",)
    assert (zenoh.socket_group, zenoh.remote) == ("motord", ())
    both = load(tmp_path, 'listen = ["tcp/127.0.0.1:7447", "unixsock-stream//run/b.sock"]')
    assert len(both.local) == 2


@pytest.mark.parametrize(
    ("zenoh", "expected"),
    [
        ('listen = ["unixsock-stream/bench.sock"]', "on a Unix socket, such as"),
        ('listen = ["unixsock-stream//run/a b"]', "on a Unix socket"),
        ('listen = ["unixsock-stream//run/b.sock;tcp/0.0.0.0:1"]', "on a Unix socket"),
        ('listen = ["unixsock-stream//run/b.sock#x=1"]', "on a Unix socket"),
        (f'listen = ["unixsock-stream//{"x" * 100}"]', "on a Unix socket"),
        ('socket_group = "motord"', "socket_group = 'motord' without an endpoint"),
    ],
)
def test_what_is_no_socket_is_refused(tmp_path, zenoh, expected):
    with pytest.raises(ConfigError, match=expected):
        load(tmp_path, zenoh)


def test_it_is_listened_on_for_user_and_group_alone(tmp_path, folder, where):
    umask = os.umask(0o022)
    os.umask(umask)
    with live_service(tmp_path, listen=where):
        made = (folder / "bench.sock").stat()
        assert (stat.S_ISSOCK(made.st_mode), stat.S_IMODE(made.st_mode)) == (True, 0o660)
        with connect(None, where) as client, client.lease("anna") as lease:
            assert client.rpc("enable", token=lease.token) == {"state": "ENABLED"}
    assert not (folder / "bench.sock").exists()
    assert os.umask(umask) == umask


def refusal(tmp_path, where, group=None):
    service = LiveService(tmp_path, where)
    with pytest.raises(ApiError) as caught:
        service.api.open([where], group)
    return str(caught.value)


def test_places_where_others_could_put_theirs_are_refused(tmp_path, folder, where):
    folder.chmod(0o777)
    assert "others may write there" in refusal(tmp_path, where)
    folder.chmod(0o775)
    assert "others may write there" in refusal(tmp_path, where)
    folder.chmod(0o755)
    (folder / "bench.sock").write_text("a thesis")
    assert "something else, which is no socket" in refusal(tmp_path, where)
    assert (folder / "bench.sock").read_text() == "a thesis"
    assert "make this folder first" in refusal(tmp_path, f"{UNIX_SOCKET}{folder}/none/bench.sock")


def test_a_group_that_does_not_exist_is_said_and_nothing_is_left_open(tmp_path, folder, where):
    assert "there is no such group" in refusal(tmp_path, where, "none-of-ours")
    assert not (folder / "bench.sock").exists()


def test_a_socket_that_a_dead_daemon_left_is_replaced_and_a_live_one_is_not(
    tmp_path, folder, where
):
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(folder / "bench.sock"))
    left.close()
    with live_service(tmp_path, listen=where):
        assert "cannot listen there" in refusal(tmp_path, where)
        with connect(None, where) as client:
            assert client.bench == "live"


def error_as(uid, gid, groups, path):
    """Return the error number of a connection by another user, 0 for none."""
    child = os.fork()
    if not child:
        code = 255
        try:
            os.setgroups(groups)
            os.setgid(gid)
            os.setuid(uid)
            with socket.socket(socket.AF_UNIX) as plain:
                code = plain.connect_ex(str(path))
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.mark.skipif(os.getuid() != 0, reason="becomes another user")
def test_only_members_of_the_group_get_in(tmp_path, folder, where, monkeypatch):
    monkeypatch.setattr(shutil, "chown", lambda path, group: os.chown(path, -1, int(group)))
    service = LiveService(tmp_path, where)
    service.api.open([where], str(GROUP))
    try:
        path = folder / "bench.sock"
        assert path.stat().st_gid == GROUP
        assert error_as(NOBODY, NOBODY, [], path) == errno.EACCES
        assert error_as(NOBODY, NOBODY, [OTHER_GROUP], path) == errno.EACCES
        assert error_as(NOBODY, NOBODY, [GROUP], path) == 0
        assert error_as(NOBODY, GROUP, [], path) == 0
    finally:
        service.api.close()


def test_the_refusal_names_who_may_connect(folder, where, monkeypatch):
    assert why_no_socket("tcp/127.0.0.1:1") == why_no_socket(where) == ""
    (folder / "bench.sock").touch()
    monkeypatch.setattr(os, "access", lambda path, mode: mode == os.X_OK)
    assert "bench.sock is for members of the group" in why_no_socket(where)
    with pytest.raises(ClientError, match="for members of the group") as caught:
        connect(None, where)
    assert caught.value.code == "forbidden"
