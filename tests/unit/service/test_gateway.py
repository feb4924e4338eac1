"""The gateway in this process, before a daemon's own pieces: who comes, goes, may do what."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest
import zenoh

from motord.api.endpoints import client_config, gateway_config
from motord.client import ClientError, connect
from motord.client.discovery import why_closed
from motord.process import ending_threads
from motord.recorder.pipe_lines import LineWriter
from motord.security import authority, identity
from motord.security.roles import Role, SecurityError
from motord.service.gateway import process
from motord.service.gateway.audit import AuditLog
from motord.service.gateway.link import GATEWAY, GatewayLink
from motord.service.host.child_pipes import LOOK_NS, SILENCE_MAX_NS, START_NS
from motord.service.host.children import Children
from motord.service.host.events import EventLog
from motord.service.processes import PROCESSES
from motord.shm.run_directory import RunDir
from tests.support.patience import PATIENCE_S
from tests.support.ports import free_port
from tests.unit.service.live_service import endpoint, live_service


@pytest.fixture
def folder(tmp_path):
    authority.init(tmp_path / "ours", [])
    authority.add(tmp_path / "ours", "anna", Role.OPERATOR)
    authority.add(tmp_path / "ours", "ben", Role.VIEWER)
    return tmp_path / "ours"


def who(folder, name):
    return identity.load(folder / "clients" / name)


class Collected:
    """What the gateway reports, in the place of a pipe."""

    dropped, waiting = 0, False

    def __init__(self):
        self.lines = []

    def write(self, line):
        self.lines.append(line)

    def flush(self):
        pass


class Opened:
    """A gateway that is kept open in a thread until the block ends."""

    def __init__(self, config, monkeypatch):
        self.out = Collected()
        self.end, self.up = threading.Event(), threading.Event()

        def until(tls, before, meanwhile):
            self.up.set()
            assert self.end.wait(PATIENCE_S)
            return process.signature(tls) != before

        monkeypatch.setattr(process, "_until_changed_or_ended", until)
        self.tls, self.config = config.zenoh.tls, config
        self.changed = None
        self.thread = threading.Thread(target=self._keep)

    def _keep(self):
        reads, speaker = AuditLog({}), process.AuditReporter(self.out)
        self.changed = process._keep_unchanged(self.config, self.tls, reads, speaker)

    def __enter__(self):
        self.thread.start()
        assert self.up.wait(PATIENCE_S)
        return self

    def __exit__(self, *error):
        self.end.set()
        self.thread.join()

    def comes_to_say(self, *parts):
        """Wait for a report with all of `parts` in it: it comes from threads of Zenoh."""
        end_s = time.monotonic() + PATIENCE_S
        while not any(all(part in said for part in parts) for said in self.said()):
            assert time.monotonic() < end_s, f"{parts} are not in {self.said()}"
            time.sleep(0.01)

    def said(self):
        return [json.loads(line)["message"] for line in self.out.lines]


@pytest.fixture(params=["tcp", "socket"])
def gated(request, tmp_path, folder, monkeypatch):
    """A gateway before a daemon on a TCP port or on nothing but a Unix socket."""
    local, remote = endpoint(), f"tls/127.0.0.1:{free_port()}"
    if request.param == "socket":
        private = tmp_path / "private"
        private.mkdir(mode=0o700)
        local = f"unixsock-stream/{private}/bench.sock"
    files = {"ca": "ca.pem", "certificate": "server.pem", "key": "server.key"}
    tls = {key: folder / name for key, name in files.items()} | {"roles": folder / "roles.toml"}
    with live_service(
        tmp_path, listen=local, zenoh={"listen": (local, remote), "tls": tls}
    ) as service, Opened(service.config, monkeypatch) as opened:  # fmt: skip
        yield SimpleNamespace(remote=remote, opened=opened, config=service.config)


@pytest.mark.parametrize("where", ["by TLS, an operator", "on the daemon's machine"])
def test_nobody_speaks_for_the_bench_to_either_side_of_the_gateway(gated, folder, where):
    """Who may command may not answer, publish or be there in the name of the bench."""
    captured, here = [], gated.config.zenoh.local[0]
    own = client_config(gated.remote, who(folder, "anna"))
    with (
        zenoh.open(own if where.startswith("by TLS") else client_config(here)) as intruder,
        connect("live", gated.remote, folder / "clients" / "anna") as client,
        connect("live", here) as local,
    ):
        for wide in ("**", "motord/live/**", "motord/live/rpc/stop", "motord/live/rpc/lease/*"):
            intruder.declare_queryable(
                wide, lambda query: captured.append(query.key_expr), complete=True
            )
        _token = intruder.liveliness().declare_token("motord/evil/alive")
        with client.subscribe_plan() as plans, local.subscribe_plan() as local_plans:
            for name in ("state", "plan", "event", "rpc/stop"):
                intruder.put(f"motord/live/{name}", b"{}")
            remote = zenoh.Locality.REMOTE
            key = "motord/live/rpc/plan/list"
            assert list(intruder.get(key, timeout=PATIENCE_S, allowed_destination=remote))
            for there in (client, local):
                with there.lease("anna") as lease:
                    assert lease.token
                assert there.rpc("stop")["state"] == "OFF"
                assert there.state().bench == "live"
            for forged in (plans, local_plans):
                assert (forged.malformed, forged.get(0.0)) == (0, None)
        for endpoint_there, identity_there in ((gated.remote, who(folder, "ben")), (here, None)):
            connect(None, endpoint_there, identity_there).close()  # there is but one bench
    assert captured == []


def test_an_operator_commands_and_a_viewer_does_not(gated, folder):
    with connect("live", gated.remote, folder / "clients" / "anna") as client:
        assert client.rpc("stop")["state"] == "OFF"
    with connect(None, gated.remote, who(folder, "ben")) as client:
        assert client.state().state == "OFF"
        assert client.rpc("plan/list")["plans"]
        assert client.mesh() is None
        with pytest.raises(ClientError, match=r"not permitted for ben \(viewer\)\?") as caught:
            client.rpc("stop")
        assert caught.value.code == "forbidden"
        with pytest.raises(ClientError, match=r"not permitted for ben"):
            client.rpc("note", text="a viewer's")
        with pytest.raises(ClientError, match="this daemon has no rpc/dance"):
            client.rpc("dance")
    assert gated.opened.said()[0].endswith("for 1 viewers and 1 operators")
    gated.opened.comes_to_say("anna (operator) has connected from 127.0.0.1:")


def test_who_is_not_let_in_gets_the_reason(gated, folder, tmp_path):
    with pytest.raises(ClientError, match="asks for a certificate"):
        connect("live", gated.remote)
    with pytest.raises(ClientError, match="an identity is a folder"):
        connect("live", gated.remote, tmp_path)
    authority.add(folder, "carl", Role.VIEWER)  # the gateway does not know yet
    with pytest.raises(ClientError, match="shows nothing to carl"):
        connect("live", gated.remote, who(folder, "carl"))
    gated.opened.comes_to_say("carl has connected", "may do nothing")
    authority.init(tmp_path / "theirs", [])
    theirs = who(folder, "anna")
    stranger = authority.add(tmp_path / "theirs", "anna", Role.OPERATOR)
    with pytest.raises(ClientError, match="its own certificate is not accepted here"):
        connect("live", gated.remote, stranger)
    (stranger / "ca.pem").write_bytes(theirs.ca.read_bytes())
    with pytest.raises(ClientError, match="does not let anna in: the certificate is from another"):
        connect("live", gated.remote, stranger)
    nobody = f"tls/127.0.0.1:{free_port()}"
    with pytest.raises(ClientError, match="is `motord run` running there"):
        connect("live", nobody, theirs)
    assert why_closed("tcp/nothing", theirs) == "expected tls/HOST:PORT"
    assert why_closed(gated.remote, theirs) == ""


def test_a_change_is_noticed(gated, folder):
    authority.remove(folder, "ben")
    gated.opened.__exit__()
    assert gated.opened.changed is True
    (folder / "server.key").unlink()
    assert process.signature(gated.config.zenoh.tls)[2] == (0, 0, 0)
    with pytest.raises(SecurityError, match=r"server\.key: cannot read it"):
        process.check(gated.config.zenoh.tls)


def test_the_gateway_goes_by_what_zenoh_itself_checks(gated):
    config = gateway_config(gated.config, {"anna": Role.OPERATOR})
    tls = json.loads(config.get_json("transport/link/tls"))
    assert (tls["enable_mtls"], tls["close_link_on_expiration"]) == (True, True)
    access = json.loads(config.get_json("access_control"))
    assert (access["enabled"], access["default_permission"]) == (True, "deny")
    assert json.loads(config.get_json("scouting/multicast/enabled")) is False


def in_its_place(script):
    """Return the gateway as a child whose process runs a script."""
    [row] = [row for row in PROCESSES if row.name == GATEWAY]
    return Children([row], lambda row: row.spawn((sys.executable, "-c", script)))


def spoken(script):
    """Return the events that a process in the gateway's place causes."""
    children, events = in_its_place(script), EventLog(lambda: 0)
    link = GatewayLink(children, events)
    link.step(0)
    children.start_all(0)
    process = children.process(GATEWAY)
    process.wait(PATIENCE_S)
    for _ in range(3):
        link.step(0)
    link.stop(0)
    return [event.message for event in events.recent()]


def test_what_the_gateway_says_becomes_an_event_whatever_it_is():
    good = json.dumps({"message": "hello", "data": {"who": "anna"}})
    bad = ["not JSON", "[1]", json.dumps({"message": "x", "data": {"kind": "an argument of emit"}})]
    fault, hello = spoken(f"print({chr(10).join([good, *bad])!r})")
    assert hello == "hello"
    assert fault.startswith("gate sent 3 lines that are no messages, the last of them")


def test_what_shows_that_the_gateway_goes_on_is_no_event():
    out = Collected()
    process.AuditReporter(out).show_alive()
    [line] = out.lines
    assert spoken(f"print({line.decode()!r})") == []


def test_a_gateway_shows_once_that_it_goes_on_to_a_daemon_that_does_not_take_it():
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    lines = LineWriter(writer, process.BACKLOG_MAX_BYTES)
    reporter = process.AuditReporter(lines)
    for _ in range(10_000):
        reporter.show_alive()
    assert lines.waiting
    os.read(reader, 1 << 20)
    lines.flush()
    assert not lines.waiting  # one message, however long it waited
    os.close(reader)
    os.close(writer)


def test_a_client_that_takes_nothing_does_not_keep_all_others_out(monkeypatch):
    """Zenoh waits more than 10 s for it: what is silent for so long is taken for one that hangs."""
    taken = threading.Event()
    monkeypatch.setattr(ending_threads, "CLOSE_S", 0.05)
    with pytest.raises(SecurityError, match="takes nothing"):
        process._close(SimpleNamespace(close=taken.wait))
    monkeypatch.setattr(ending_threads, "CLOSE_S", PATIENCE_S)
    taken.set()
    process._close(SimpleNamespace(close=taken.wait))


def test_a_gateway_that_shows_nothing_is_ended_and_started_again():
    children, events = in_its_place("import sys; sys.stdin.read()"), EventLog(lambda: 0)
    link = GatewayLink(children, events)
    children.start_all(0)
    stopped = children.process(GATEWAY)
    for now_ns in range(0, START_NS + 1, LOOK_NS):
        link.step(now_ns)
    assert children.poll(START_NS) == []
    link.step(START_NS + 1)
    assert stopped.wait(PATIENCE_S) == -signal.SIGKILL
    [end] = children.poll(START_NS + 1)
    children.poll(START_NS + 1 + round(end.again_s * 1e9))
    assert children.process(GATEWAY) not in (None, stopped)
    link.step(2 * START_NS)  # of the first
    for now_ns in range(2 * START_NS, 3 * START_NS + 1, LOOK_NS):  # of the next one
        link.step(now_ns)
    link.stop(3 * START_NS)
    assert [e.message for e in events.recent()] == [
        "gate has sent nothing for 60 s since it was started; it is ended"
    ]


def test_a_gateway_that_was_up_is_ended_sooner():
    children, events = (
        in_its_place('print(\'{"message":"up"}\', flush=True); input()'),
        EventLog(lambda: 0),
    )
    link, end_s = GatewayLink(children, events), time.monotonic() + PATIENCE_S
    children.start_all(0)
    while not events.recent() and time.monotonic() < end_s:
        link.step(0)
    process = children.process(GATEWAY)
    for now_ns in range(0, SILENCE_MAX_NS + 1, LOOK_NS):
        link.step(now_ns)
    assert children.poll(SILENCE_MAX_NS) == []
    link.step(SILENCE_MAX_NS + 1)
    assert process.wait(PATIENCE_S) == -signal.SIGKILL
    link.stop(SILENCE_MAX_NS + 1)
    assert [e.message for e in events.recent()] == [
        "up", "gate has sent nothing for 10 s; it is ended",
    ]  # fmt: skip


def test_silence_while_the_daemon_was_stopped_itself_is_none():
    """As by Ctrl-Z: the processes that it started were stopped with it."""
    children, events = in_its_place("input()"), EventLog(lambda: 0)
    link = GatewayLink(children, events)
    children.start_all(0)
    link.step(0)
    link.step(2 * START_NS)
    assert events.recent() == []
    for now_ns in range(2 * START_NS, 3 * START_NS + 1, LOOK_NS):
        link.step(now_ns)
    assert "for 60 s since it was started" in events.recent()[0].message
    link.stop(3 * START_NS)


FLOODS = {
    "random lines": "while True: o.write(r.randbytes(80) + b'\\n')",
    "a line without end": "while True: o.write(b'x' * 65536)",
    "good messages": 'while True: o.write(b\'{"message":"hello"}\\n\')',
}


@pytest.mark.parametrize("flood", FLOODS)
def test_a_gateway_that_floods_is_ended_and_started_again(flood):
    script = f"import random, sys; r = random.Random(5); o = sys.stdout.buffer\n{FLOODS[flood]}"
    children, events = in_its_place(script), EventLog(lambda: 0)
    link = GatewayLink(children, events)
    children.start_all(0)
    first, ends, end_s = children.process(GATEWAY), [], time.monotonic() + PATIENCE_S
    while not ends and time.monotonic() < end_s:
        link.step(0)  # no time passes: whatever comes is at once
        ends += children.poll(0)
    children.poll(10**9)
    assert children.process(GATEWAY) not in (None, first)
    link.step(10**9)  # of the first
    link.step(10**9)  # of the next one
    link.stop(10**9)
    first.wait(PATIENCE_S)
    assert [end.how for end in ends] == ["killed by SIGKILL"]
    reported = [e for e in events.recent() if e.kind == "process"]
    assert 1 <= len(reported) <= 3
    assert any("more than can be meant" in e.message for e in reported)
    assert len(events.recent()) <= 110  # or it would drown all others


def test_a_gateway_that_cannot_open_says_why(tmp_path):
    command = RunDir("none").command("motord.service.gateway.process", tmp_path / "none.toml")
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 1
    assert "none.toml: cannot read it" in json.loads(done.stdout)["message"]


def test_zenohs_log_is_taken_over_from_stdout():
    script = (
        "import os; from motord.service.gateway.process import take_over_stdout as take\n"
        "log, out = take(); os.write(1, b'inner\\n'); line = log.readline()\n"
        "out.write(b'outer ' + line.encode())\n"
        "out.flush()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "outer inner\n"


def test_the_gateway_ends_with_its_daemon(monkeypatch, folder):
    files = {"ca": "ca.pem", "certificate": "server.pem", "key": "server.key"}
    tls = SimpleNamespace(**{k: folder / n for k, n in files.items()}, roles=folder / "roles.toml")
    before = process.signature(tls)
    monkeypatch.setattr(process, "LOOK_S", 0.01)
    reader, writer = os.pipe()
    monkeypatch.setattr("motord.service.gateway.process.STDIN", reader)
    authority.remove(folder, "ben")
    assert process._until_changed_or_ended(tls, before, lambda: None) is True
    os.close(writer)
    assert process._until_changed_or_ended(tls, process.signature(tls), lambda: None) is False
    os.close(reader)
