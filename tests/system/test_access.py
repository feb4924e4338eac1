"""Who gets in from other machines, and what they may do there: a daemon, its gateway, real TLS."""

import json
import os
import random
import re
import socket

import pytest
import zenoh
from typer.testing import CliRunner

from motord.api.endpoints import client_config
from motord.cli import app
from motord.client import ClientError, connect
from motord.security import authority, identity, roles
from motord.security.roles import Role
from tests.support.patience import PATIENCE_S, until
from tests.support.ports import free_port
from tests.system.daemons import daemon, wait_for, write_sim

pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def certificates(folder):
    """anna operates, ben watches, carl's role was taken away, dora's certificate has expired."""
    for name in ("ours", "theirs"):
        authority.init(folder / name, [])
        authority.add(folder / name, "anna", Role.OPERATOR)
    ours = folder / "ours"
    authority.add(ours, "ben", Role.VIEWER)
    authority.add(ours, "carl", Role.OPERATOR)
    authority.remove(ours, "carl")
    authority.add(ours, "dora", Role.OPERATOR, days=0)
    return ours


@pytest.fixture(scope="module")
def bench(folder, certificates):
    path = write_sim(folder, "gated")
    remote = f"tls/127.0.0.1:{free_port()}"
    text = re.sub(r'listen = \["(.*)"\]', rf'listen = ["\1", "{remote}"]', path.read_text())
    files = {"ca": "ca.pem", "certificate": "server.pem", "key": "server.key"}
    lines = "".join(f'{key} = "ours/{name}"\n' for key, name in files.items())
    path.write_text(f'{text}\n[zenoh.tls]\n{lines}roles = "ours/roles.toml"\n')
    with daemon(folder, path) as running:
        running.remote = remote
        with running.connect() as client:
            logged(client, "open to other machines")
        yield running


def who(certificates, name):
    return identity.load(certificates / "clients" / name)


def logged(client, text):
    """Wait until the daemon's event log has `text`, and return that event."""
    found = []

    def look():
        found[:] = [e for e in client.events() if e.kind == "access" and text in e.message]
        return found

    until(look, f"an event: {text}")
    return found[-1]


def refused_at_the_door(bench, shown):
    with pytest.raises(ClientError) as caught:
        connect("gated", bench.remote, shown)
    return caught.value


def test_an_operator_commands(bench, certificates):
    with connect(None, bench.remote, who(certificates, "anna")) as client:
        assert client.bench == "gated"
        with client.subscribe_ticks() as blocks:
            assert len(blocks.get(PATIENCE_S))
        with client.lease("anna") as lease:
            assert client.rpc("enable", token=lease.token) == {"state": "ENABLED"}
        wait_for(client, lambda s: s.state == "READY", "disabled")
        assert client.rpc("stop", by="anna")["state"] == "OFF"
        assert "anna (operator) has connected from 127.0.0.1:" in logged(client, "anna (op").message
    with bench.connect() as client:
        logged(client, "anna at 127.0.0.1")


def test_a_viewer_watches(bench, certificates):
    with connect("gated", bench.remote, who(certificates, "ben")) as client:
        assert client.state().bench == "gated"
        assert client.events()
        assert client.plan() is None
        assert client.rpc("plan/list")["plans"]
        for subscribe in (client.subscribe_state, client.subscribe_ticks):
            with subscribe() as coming:
                assert coming.get(PATIENCE_S) is not None


@pytest.mark.parametrize("name", ["lease/acquire", "enable", "stop", "set", "plan/start"])
def test_a_viewer_who_commands_is_refused_and_logged(bench, certificates, name):
    with (
        connect("gated", bench.remote, who(certificates, "ben")) as client,
        pytest.raises(ClientError, match=r"not permitted for ben \(viewer\)") as caught,
    ):
        client.rpc(name, token="x", holder="ben")
    assert caught.value.code == "forbidden"
    with bench.connect() as client:
        event = logged(client, f"ben (viewer) may not ask for motord/gated/rpc/{name}")
        assert event.data["who"] == "ben"
        assert client.state().lease.holder is None
        assert not any(e.kind == "lease" and "ben" in e.message for e in client.events())


def test_a_viewer_cannot_speak_in_the_name_of_the_bench(bench, certificates):
    config = client_config(bench.remote, who(certificates, "ben"))
    seen = []
    with bench.connect() as local, zenoh.open(config) as session:
        with local.subscribe_plan(seen.append), local.subscribe_state() as states:
            session.put("motord/gated/plan", b"null")
            session.declare_queryable(
                "motord/gated/rpc/stop", lambda query: query.reply(query.key_expr, b"{}")
            )
            event = logged(local, "ben (viewer) may not publish motord/gated/plan")
            assert states.get(PATIENCE_S) is not None
        assert event.data["action"] == "Put"
        assert not seen
        assert local.rpc("stop", by="a test")["state"] == "OFF"


@pytest.mark.parametrize("name", ["ben", "anna"])
def test_wildcards_do_not_widen_a_role(bench, certificates, name):
    """The gateway lets no viewer's wildcard through, and the daemon's router no operator's."""
    with bench.connect() as client, client.lease("a test") as lease:
        client.rpc("enable", token=lease.token)
        with zenoh.open(client_config(bench.remote, who(certificates, name))) as session:
            for wide in ("motord/gated/**", "**", "motord/*/rpc/stop", "motord/gated/rpc/*"):
                assert [r for r in session.get(wide, timeout=2.0) if r.ok is not None] == []
                assert client.state().state == "ENABLED"
            [listed] = session.get("motord/gated/rpc/plan/list")
            assert listed.ok is not None
    with bench.connect() as client:
        wait_for(client, lambda s: s.state == "READY", "disabled")
        assert client.rpc("stop", by="a test")["state"] == "OFF"


def test_a_certificate_without_a_role_may_do_nothing(bench, certificates):
    error = refused_at_the_door(bench, who(certificates, "carl"))
    assert (error.code, "shows nothing to carl" in str(error)) == ("forbidden", True)
    with bench.connect() as client:
        event = logged(client, "but has no role here and may do nothing")
        assert event.message.startswith("carl has connected from 127.0.0.1:")


def test_a_client_without_certificate_is_refused(bench, certificates):
    assert refused_at_the_door(bench, None).code == "forbidden"
    anonymous = client_config(bench.remote)
    anonymous.insert_json5(
        "transport/link/tls", json.dumps({"root_ca_certificate": str(certificates / "ca.pem")})
    )
    with pytest.raises(zenoh.ZError):
        zenoh.open(anonymous)
    with bench.connect() as client:
        logged(client, "refused a connection: it showed no certificate")


def test_an_unencrypted_client_is_refused(bench):
    with pytest.raises(zenoh.ZError):
        zenoh.open(client_config(bench.remote.replace("tls/", "tcp/")))
    with bench.connect() as client:
        logged(client, "refused a connection: it does not speak TLS")


def test_a_certificate_of_another_authority_is_refused(bench, certificates, folder):
    theirs = who(folder / "theirs", "anna")
    error = refused_at_the_door(bench, theirs)  # it does not even trust the daemon
    assert "its own certificate is not accepted here" in str(error)
    (theirs.folder / "ca.pem").write_bytes((certificates / "ca.pem").read_bytes())
    error = refused_at_the_door(bench, theirs)
    assert error.code == "forbidden"
    with bench.connect() as client:
        logged(client, "refused a connection: its certificate is from another authority")


def test_an_expired_certificate_is_refused(bench, certificates):
    error = refused_at_the_door(bench, who(certificates, "dora"))
    assert (error.code, "expired" in str(error)) == ("forbidden", True)
    with bench.connect() as client:
        logged(client, "refused a connection: its certificate has expired")


def test_the_command_line_shows_an_identity(bench, certificates):
    def motord(*arguments, **environment):
        return CliRunner().invoke(app, arguments, env=environment)

    own = {"MOTORD_IDENTITY": str(certificates / "clients" / "ben")}
    done = motord("status", "--connect", bench.remote, "--json", **own)
    assert json.loads(done.stdout)["bench"] == "gated"
    done = motord("stop", "--connect", bench.remote, "--identity", own["MOTORD_IDENTITY"])
    assert (done.exit_code, "not permitted for ben (viewer)" in done.stderr) == (1, True)
    done = motord("plan", "list", MOTORD_CONNECT=bench.remote)
    assert (done.exit_code, "asks for a certificate" in done.stderr) == (1, True)


def test_a_role_counts_at_once(bench, certificates):
    erik = identity.load(authority.add(certificates, "erik", Role.OPERATOR))
    with bench.connect() as client:
        logged(client, "for 1 viewers and 3 operators")
        with connect("gated", bench.remote, erik) as remote:
            assert remote.rpc("stop")["state"] == "OFF"
            authority.remove(certificates, "erik")
            until(lambda: not _lets_in(bench, erik), "the role to be gone")
        roles_path = certificates / authority.ROLES
        good = roles_path.read_text()
        roles_path.write_text("[roles]\nanna = 'king'\n")
        logged(client, "anna = 'king': a role is one of")
        assert not _lets_in(bench, who(certificates, "anna"))
        roles_path.write_text(good)
        until(lambda: _lets_in(bench, who(certificates, "anna")), "anna to be back")
        shown = who(certificates, "anna")
        with connect("gated", bench.remote, shown) as remote, remote.lease("anna") as lease:
            assert lease.token
    assert roles.read(roles_path)["anna"] is Role.OPERATOR


def test_a_commander_stays_in_command_when_roles_change(bench, certificates):
    with (
        bench.connect() as local,
        connect("gated", bench.remote, who(certificates, "anna")) as client,
        client.lease("anna") as lease,
    ):
        assert client.rpc("enable", token=lease.token) == {"state": "ENABLED"}
        authority.add(certificates, "frida", Role.VIEWER)
        logged(local, "for 2 viewers and 2 operators")
        until(lambda: _answers(client), "the connection to be back")
        assert client.state().state == "ENABLED"
        assert not lease.lost.is_set()


def _answers(client):
    try:
        client.state()
    except ClientError:
        return False
    return True


def _lets_in(bench, shown):
    try:
        connect("gated", bench.remote, shown).close()
    except ClientError:
        return False
    return True


def test_the_bench_goes_on_when_the_gateway_is_killed(bench, certificates):
    with bench.connect() as client, client.lease("local") as lease:
        client.rpc("enable", token=lease.token)
        gateway = client.state().processes["gate"]
        os.kill(gateway.pid, 9)
        wait_for(
            client,
            lambda s: (
                s.processes["gate"].running and s.processes["gate"].restarts > gateway.restarts
            ),
            "another gateway",
        )
        assert client.state().state == "ENABLED"
        until(lambda: _lets_in(bench, who(certificates, "anna")), "anna to get in again")
        assert not lease.lost.is_set()


def test_garbage_at_the_gateway_holds_up_nothing(bench, certificates):
    host, port = bench.remote.removeprefix("tls/").split(":")
    garbage = random.Random(1)
    for n in range(20):
        with socket.create_connection((host, int(port))) as plain:
            plain.sendall(garbage.randbytes(200 * (n + 1)))
    with connect("gated", bench.remote, who(certificates, "anna")) as client:
        assert client.rpc("stop")["state"] == "OFF"
