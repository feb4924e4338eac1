"""Who may come in, what a page receives, and what it may ask for."""

import asyncio
import struct
import warnings
from types import SimpleNamespace

import pytest
from starlette.websockets import WebSocketDisconnect

from motord import config
from motord.api.messages import BenchState, CalibrationView
from motord.api.queue_messages import QueueView
from motord.client import ClientError
from motord.dashboard.app import MALFORMED, MESSAGES_AT_ONCE, TOO_MANY_MESSAGES, application
from motord.dashboard.frames import decode, encode
from motord.dashboard.live_bench import LiveBench
from motord.dashboard.page.messages import VIEWS_MAX
from motord.dashboard.page.pages import PAGES_MAX, Pages
from motord.dashboard.tokens import Tokens
from motord.security.roles import Role
from tests.unit.dashboard.fake_link import LEASE_S, FakeLink
from tests.unit.dashboard.ticks import block

with warnings.catch_warnings():  # that it should be used with httpx2, which few systems have
    warnings.simplefilter("ignore")
    from starlette.testclient import TestClient, WebSocketDenialResponse

HOST = "127.0.0.1:8447"
ORIGIN = {"Origin": f"http://{HOST}"}


class Server:
    """The application in this process."""

    def __init__(self, tokens):
        self.tokens = tokens
        self.link = FakeLink()
        self.bench = LiveBench("sim", config.load().model_dump(mode="json"))
        self.pages = Pages(self.bench, self.link, "anna@bench")
        self.bench.publish = self.pages.publish
        self.client = TestClient(
            application(self.pages, tokens, self.link), base_url=f"http://{HOST}"
        )

    def socket(self, token=None, protocols=None, **headers):
        token = self.tokens.operator if token is None else token
        return self.client.websocket_connect(
            f"ws://{HOST}/socket",
            subprotocols=protocols or ["motord.1", token],
            headers={**ORIGIN, **headers},
        )

    def come(self, *items):
        """Let items come from the daemon."""
        self.client.portal.call(self.link.take, list(items))


@pytest.fixture(scope="module")
def tokens():
    return Tokens()


@pytest.fixture
def server(tokens):
    server = Server(tokens)
    with server.client:
        yield server


def send(socket, **header):
    socket.send_bytes(encode(header))


def receive(socket, kind, **wanted):
    """Return header and floats of the next message of a kind; pings are answered."""
    while True:
        header, floats = decode(socket.receive_bytes())
        if header["kind"] == "ping":
            send(socket, kind="pong", n=header["n"])
        if header["kind"] == kind and wanted.items() <= header.items():
            return header, floats


def ask(socket, name, number=1, **arguments):
    """Return the reply, or the code of the error."""
    send(socket, kind="rpc", id=number, name=name, arguments=arguments)
    header, _ = receive(socket, "reply", id=number)
    return header["reply"] if "reply" in header else header["error"]["code"]


# Coming in


def test_the_tokens_are_long_and_not_the_same(tokens):
    assert tokens.operator != tokens.viewer
    assert min(len(tokens.operator), len(tokens.viewer)) >= 43  # 256 bits in base64


@pytest.mark.parametrize(
    ("authorization", "status"),
    [
        ("Bearer {operator}", 200),
        ("bearer {viewer}", 200),
        ("Bearer {operator}x", 401),
        ("Bearer ", 401),
        ("Bearer grün", 401),
        ("Basic {operator}", 401),
        ("", 401),
    ],
)
def test_the_session_says_whether_a_token_is_good(server, tokens, authorization, status):
    given = authorization.format(operator=tokens.operator, viewer=tokens.viewer)
    headers = {"Authorization": given.encode()}
    reply = server.client.get("/session", headers=headers)
    assert reply.status_code == status
    role = "viewer" if "viewer" in authorization else "operator"
    assert reply.json().get("role", role) == role
    assert "motord dashboard" in reply.json().get("error", "motord dashboard")


@pytest.mark.parametrize("path", ["/session", "/", "/vendor/uPlot.esm.js", "/nowhere"])
def test_every_answer_has_the_headers(server, path):
    headers = server.client.get(path).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cross-origin-opener-policy"] == "same-origin"
    assert headers["cache-control"] == "no-cache"  # a page of an older version would not fit
    assert headers["cross-origin-resource-policy"] == "same-origin"


@pytest.mark.parametrize("path", ["/../app.py", "/%2e%2e/app.py", "/..%2fapp.py", "//etc/passwd"])
def test_no_other_file_is_served(server, path):
    assert server.client.get(path).status_code == 404


@pytest.mark.parametrize(
    ("host", "status"),
    [
        (HOST, 401),
        ("localhost:9000", 401),
        ("[::1]:9000", 401),
        ("bench.example:8447", 403),
        ("127.0.0.1.example", 403),
        ("[::1", 403),
        ("", 403),
    ],
)
def test_only_names_of_this_machine_are_a_host(server, host, status):
    reply = server.client.get("/session", headers={"Host": host})
    assert reply.status_code == status
    assert reply.headers["x-content-type-options"] == "nosniff"


FOREIGN = ["http://example.com", "http://localhost:8447", "https://127.0.0.1:8447", "null"]


@pytest.mark.parametrize("origin", FOREIGN)
def test_a_foreign_origin_is_refused(server, origin):
    assert server.client.get("/session", headers={"Origin": origin}).status_code == 403
    with pytest.raises(WebSocketDenialResponse) as refused, server.socket(Origin=origin):
        pass
    assert refused.value.status_code == 403
    assert origin in refused.value.text


@pytest.mark.parametrize(
    "protocols",
    [["motord.1"], ["motord.1", "wrong"], ["motord.2", "{token}"], ["{token}"], ["wrong", "x"]],
)
def test_a_socket_without_its_token_is_refused(server, tokens, protocols):
    offered = [protocol.format(token=tokens.operator) for protocol in protocols]
    with pytest.raises(WebSocketDenialResponse) as refused, server.socket(protocols=offered):
        pass
    assert refused.value.status_code == 401


def test_pages_are_not_without_number(server):
    sockets = [server.socket() for _ in range(PAGES_MAX)]
    for socket in sockets:
        socket.__enter__()
    with pytest.raises(WebSocketDenialResponse) as refused, server.socket():
        pass
    assert refused.value.status_code == 503
    for socket in sockets:
        socket.__exit__(None, None, None)
    with server.socket() as socket:
        receive(socket, "hello")


# What a page receives


def test_a_page_gets_what_it_needs_first(server):
    with server.socket() as socket:
        assert socket.accepted_subprotocol == "motord.1"
        header, _ = receive(socket, "hello")
        assert header["bench"] == "sim"
        assert header["role"] == "operator"
        assert header["history_s"] >= 600
        assert header["limits"]["torque_Nm"] == 6.0
        assert header["trips"]["OVER_SPEED"]["action"]
        assert {
            "name": "torque_Nm",
            "label": "measured",
            "unit": "Nm",
            "group": "torque",
        } in header["signals"]
        assert receive(socket, "events")[0]["data"] == []
        assert receive(socket, "lease")[0]["held"] is False
        assert receive(socket, "connection")[0]["alive"] is True


def test_a_table_too_long_for_a_page_stays_here(tokens):
    server = Server(tokens)
    server.bench.config["motor"]["back_emf"] = [0.0] * 1_000_000
    header, _ = decode(server.bench.hello("viewer"))
    assert "back_emf" not in header["config"]["motor"]
    assert header["config"]["motor"]["counts"] == 4096


def test_a_live_view_is_whole_and_then_what_is_new(server):
    epoch_ns = server.bench.epoch_ns
    server.come(("ticks", block(1000, t0_ns=epoch_ns, torque_Nm=1.0)))
    view = {"view": 3, "span_s": 10.0, "end_s": None, "buckets": 100, "signals": ["torque_Nm"]}
    with server.socket() as socket:
        send(socket, kind="view", **view)
        first, floats = receive(socket, "trace")
        assert (first["view"], first["whole"], first["live"]) == (3, True, True)
        assert first["dt_s"] == pytest.approx(0.1, rel=0.25)
        assert len(floats) == 2 * first["buckets"]
        end = round(first["t0_s"] / first["dt_s"]) + first["buckets"]
        server.come(("ticks", block(100, first=1000, t0_ns=epoch_ns, torque_Nm=5.0)))
        then, floats = receive(socket, "trace")
        assert then["whole"] is False
        assert round(then["t0_s"] / then["dt_s"]) in (end - 1, end)
        assert floats.max() == 5.0


def test_a_view_at_rest_is_sent_once(server):
    epoch_ns = server.bench.epoch_ns
    server.come(("ticks", block(1000, t0_ns=epoch_ns, torque_Nm=1.0)))
    with server.socket() as socket:
        wanted = {"view": 0, "span_s": 0.2, "end_s": 0.5, "buckets": 50, "signals": ["torque_Nm"]}
        send(socket, kind="view", **wanted)
        header, floats = receive(socket, "trace")
        assert header["live"] is False
        assert header["t0_s"] == pytest.approx(0.3)
        assert floats.tolist() == [1.0] * 100
        server.come(("ticks", block(10, first=1000, t0_ns=epoch_ns)))
        send(socket, kind="view", **{**wanted, "view": 1})
        assert receive(socket, "trace")[0]["view"] == 1


def test_lost_ticks_are_reported(server):
    epoch_ns = server.bench.epoch_ns
    server.come(("ticks", block(100, t0_ns=epoch_ns)))
    server.come(("ticks", block(100, first=142, t0_ns=epoch_ns)))
    with server.socket() as socket:
        wanted = {"span_s": 1.0, "end_s": None, "buckets": 10, "signals": ["i_a_A"]}
        send(socket, kind="view", view=0, **wanted)
        assert receive(socket, "trace")[0]["lost"] == 42


def test_a_hidden_page_gets_no_traces(server):
    epoch_ns = server.bench.epoch_ns
    with server.socket() as socket:
        send(socket, kind="visible", value=False)
        wanted = {"span_s": 1.0, "end_s": None, "buckets": 10, "signals": ["i_a_A"]}
        send(socket, kind="view", view=0, **wanted)
        ask(socket, "plan/list")
        server.come(("ticks", block(100, t0_ns=epoch_ns)))
        send(socket, kind="rpc", id=2, name="plan/list", arguments={})
        kinds = []
        while kinds.count("connection") < 2 or "reply" not in kinds:
            kinds.append(decode(socket.receive_bytes())[0]["kind"])
        assert not {"trace", "turns", "timing"} & set(kinds)
        send(socket, kind="visible", value=True)
        assert receive(socket, "trace")[0]["whole"] is True


@pytest.mark.parametrize("given", [{"end_s": 1e308}, {"end_s": -1e300}, {"span_s": 86_400.0}])
def test_a_window_beyond_all_history_is_refused(server, given):
    wanted = {"view": 0, "span_s": 1.0, "end_s": None, "buckets": 10, "signals": ["i_a_A"]}
    with server.socket() as socket:
        send(socket, kind="view", **{**wanted, **given})
        assert next(iter(given)) in receive(socket, "error", code=MALFORMED)[0]["message"]


def test_a_silent_daemon_is_reported(server):
    with server.socket() as socket:
        server.link.alive = False
        header, _ = receive(socket, "connection", alive=False)
        assert header["message"] == "the daemon is gone"


# What a page may ask for


def test_a_page_commands_with_its_lease(server):
    with server.socket() as socket:
        assert ask(socket, "enable") == "no_lease"
        assert server.link.named("enable") == []
        assert ask(socket, "lease/acquire")["holder"] == "anna@bench page 1"
        assert receive(socket, "lease", held=True)[0]["remaining_s"] > 0
        assert ask(socket, "set", torque_Nm=1.0, token="of another") == {"state": "READY"}
        assert server.link.named("set") == [{"torque_Nm": 1.0, "token": server.link.token}]
        assert ask(socket, "lease/release") == {}
        assert receive(socket, "lease", held=False)
        assert ask(socket, "disable") == "no_lease"


def test_the_token_of_the_lease_stays_in_the_server(server):
    with server.socket() as socket:
        assert "token" not in ask(socket, "lease/acquire")
        assert server.link.token


def test_a_stop_needs_no_lease(server):
    with server.socket() as socket:
        assert ask(socket, "stop", by="somebody else") == {"state": "READY"}
        assert server.link.named("stop") == [{"by": "anna@bench page 1"}]


@pytest.mark.parametrize("name", ["lease/renew", "nonsense", "../state", ""])
def test_what_is_no_rpc_of_a_page_is_refused(server, name):
    with server.socket() as socket:
        assert ask(socket, name) == "unknown"


VIEWERS_MAY_NOT = ["stop", "lease/acquire", "plan/start", "set", "queue/add", "queue/start"]


@pytest.mark.parametrize("name", VIEWERS_MAY_NOT)
def test_a_viewer_commands_nothing(server, tokens, name):
    with server.socket(tokens.viewer) as socket:
        assert receive(socket, "hello")[0]["role"] == "viewer"
        assert ask(socket, name) == "forbidden"
        assert ask(socket, "plan/list", 2) == {"state": "READY"}
    assert [called for called, _ in server.link.calls if called != "config"] == ["plan/list"]


def test_of_a_viewers_identity_both_tokens_are_viewers():
    server = Server(Tokens(Role.VIEWER))
    with server.client, server.socket() as socket:
        assert receive(socket, "hello")[0]["role"] == "viewer"


def test_the_lease_is_renewed_by_answers_to_the_newest_ping_alone(server, monkeypatch):
    now_s = 100.0
    clock = SimpleNamespace(monotonic=lambda: now_s)
    monkeypatch.setattr("motord.dashboard.page.lease.time", clock)
    with server.socket() as socket:
        ask(socket, "lease/acquire")
        all_taken(socket, 8)
        before = len(server.link.named("lease/renew"))
        newest = receive_unanswered(socket, "ping")["n"]
        for n in (newest - 1, newest + 1_000_000, -1):  # the next one may come before its answer
            send(socket, kind="pong", n=n)
        all_taken(socket, 9)
        now_s += LEASE_S + 1.0
        header = receive_unanswered(socket, "lease", held=False)
        assert "ran out" in header["why"]
        assert len(server.link.named("lease/renew")) == before


def all_taken(socket, number):
    """Wait until all that was sent has been taken; answer nothing meanwhile."""
    send(socket, kind="rpc", id=number, name="plan/list", arguments={})
    receive_unanswered(socket, "reply", id=number)


def receive_unanswered(socket, kind, **wanted):
    while True:
        header, _ = decode(socket.receive_bytes())
        if header["kind"] == kind and wanted.items() <= header.items():
            return header


def test_a_page_that_goes_gives_the_lease_back(server):
    with server.socket() as socket:
        ask(socket, "lease/acquire")
    assert len(server.link.named("lease/release")) == 1


def test_a_lease_that_was_taken_over_is_lost(server):
    with server.socket() as first, server.socket() as second:
        ask(first, "lease/acquire")
        assert ask(second, "lease/acquire") == "lease_held"
        assert ask(second, "lease/acquire", 2, force=True)["holder"] == "anna@bench page 2"
        assert receive(first, "lease", held=False)[0]["why"] == "the lease is over"


def test_a_refusal_of_the_daemon_reaches_the_page(server):
    server.link.errors["plan/start"] = ClientError("refused", "OFF")
    with server.socket() as socket:
        send(socket, kind="rpc", id=7, name="plan/start", arguments={"name": "verify"})
        header, _ = receive(socket, "reply", id=7)
        assert header["error"] == {"code": "refused", "message": "OFF"}


# What is malformed

BAD = {
    "short": b"\x01",
    "no JSON": struct.pack("<I", 4) + b"{{{{",
    "a kind that is no text": struct.pack("<I", 12) + b'{"kind": 1} ',
    "view without a span": encode({"kind": "view", "view": 1}),
    "view without end": encode(
        {"kind": "view", "view": 1, "span_s": 1e300, "end_s": None, "buckets": 10, "signals": []}
    ),
    "too many buckets": encode(
        {"kind": "view", "view": 1, "span_s": 1, "end_s": None, "buckets": 10**9, "signals": []}
    ),
    "too many views": encode(
        {"kind": "view", "view": VIEWS_MAX, "span_s": 1, "end_s": 0, "buckets": 1, "signals": []}
    ),
    "unknown signal": encode(
        {"kind": "view", "view": 1, "span_s": 1, "end_s": 0, "buckets": 1, "signals": ["x"]}
    ),
    "unknown signal in other letters": encode(
        {
            "kind": "view",
            "view": 1,
            "span_s": 1,
            "end_s": 0,
            "buckets": 1,
            "signals": ["\u03a9" * 200],
        }
    ),
    "half a letter": encode(
        {"kind": "view", "view": 1, "span_s": 1, "end_s": 0, "buckets": 1, "signals": ["\ud800"]}
    ),
    "half a letter in a name": encode({"kind": "rpc", "id": 1, "name": "\ud800"}),
    "rpc without a name": encode({"kind": "rpc", "id": 1}),
    "rpc with a list": encode({"kind": "rpc", "id": 1, "name": "stop", "arguments": []}),
    "pong of text": encode({"kind": "pong", "n": "one"}),
}


@pytest.mark.parametrize("name", BAD)
def test_a_malformed_message_ends_the_socket_and_nothing_else(server, name):
    with server.socket() as good, server.socket() as bad:
        ask(bad, "lease/acquire")
        bad.send_bytes(BAD[name])
        header, _ = receive(bad, "error")
        assert header["code"] == MALFORMED
        assert header["message"]
        with pytest.raises(WebSocketDisconnect) as closed:
            bad.receive_bytes()
        assert closed.value.code == MALFORMED
        assert 0 < len(closed.value.reason.encode()) <= 123
        assert ask(good, "stop") == {"state": "READY"}
    assert len(server.link.named("lease/release")) == 1


def test_text_is_malformed(server):
    with server.socket() as socket:
        socket.send_text("{}")
        assert receive(socket, "error")[0]["code"] == MALFORMED


def test_unknown_kinds_are_skipped(server):
    with server.socket() as socket:
        send(socket, kind="of a later version", text="x")
        assert ask(socket, "stop") == {"state": "READY"}


def test_a_page_that_floods_is_closed(server):
    with server.socket() as socket:
        for _ in range(2 * round(MESSAGES_AT_ONCE)):
            send(socket, kind="visible", value=True)
        assert receive(socket, "error")[0]["code"] == TOO_MANY_MESSAGES


# Restarts and calibrations of the daemon


def state(uptime_s, calibration=None):
    return BenchState.model_construct(uptime_s=uptime_s, calibration=calibration)


def test_a_socket_that_the_server_closed_by_itself_ends_without_an_error(server):
    scope = {
        "type": "websocket", "path": "/socket", "raw_path": b"/socket", "query_string": b"",
        "headers": [(b"host", HOST.encode()), (b"origin", ORIGIN["Origin"].encode())],
        "subprotocols": ["motord.1", server.tokens.operator], "extensions": {},
    }  # fmt: skip
    come = [{"type": "websocket.connect"}]

    async def receive():
        return come.pop() if come else await asyncio.Future()

    async def send(message):
        if message["type"] == "websocket.send":  # as uvicorn does
            raise RuntimeError("Unexpected ASGI message 'websocket.send', after 'websocket.close'.")

    server.client.portal.call(server.client.app, scope, receive, send)


def test_every_page_gets_the_queue_as_the_daemon_reports_it(server, tokens):
    reported = state(1.0).model_copy(update={"queue": QueueView(length=1)})
    with server.socket() as first, server.socket(tokens.viewer) as viewer:
        server.come(("state", reported))
        for socket in (first, viewer):
            assert receive(socket, "queue")[0]["data"] == {"state": "READY"}
        assert ask(first, "queue/move", id=1, position=1) == "no_lease"
    with server.socket() as later:
        assert receive(later, "queue")[0]["data"] == {"state": "READY"}


def test_a_restart_of_the_daemon_ends_every_lease(server):
    server.come(("state", state(100.0)))
    with server.socket() as socket:
        ask(socket, "lease/acquire")
        server.come(("state", state(0.1)))
        assert "started again" in receive(socket, "lease", held=False)[0]["why"]


def test_another_bench_file_after_a_restart_begins_the_history_anew(server):
    server.come(("ticks", block(1000, t0_ns=server.bench.epoch_ns)))
    with server.socket() as socket:
        assert receive(socket, "hello")[0]["rate_Hz"] == config.load().loop.rate_Hz
        server.bench.config["loop"]["rate_Hz"] = 50
        server.client.portal.call(server.pages.connected)
        receive(socket, "hello")
        assert server.bench.history.end == 0


def test_orders_of_the_calibration_in_force_are_marked(server):
    server.link.harmonics = [
        {"order": order, "amplitude_Nm": amplitude_Nm, "stderr_Nm": stderr_Nm}
        for order, amplitude_Nm, stderr_Nm in ((8, 0.1, 0.001), (24, 0.1, 0.06), (48, -0.1, 0.001))
    ]
    server.come(("state", state(1.0, CalibrationView.model_construct(id="ab"))))
    turn = block(2500, rate_Hz=1000.0, t0_ns=server.bench.epoch_ns, turns_per_s=1.0)
    with server.socket() as socket:
        while not server.bench.calibrated:
            ask(socket, "plan/list")
        server.come(("ticks", turn))
        assert receive(socket, "turns")[0]["calibrated"] == [8, 48]


def test_orders_that_the_daemon_did_not_give_are_asked_for_again(server, monkeypatch):
    monkeypatch.setattr("motord.dashboard.page.pages.LOOK_UP_S", 0.0)
    server.link.harmonics = [{"order": 8, "amplitude_Nm": 0.1, "stderr_Nm": 0.001}]
    server.link.errors["calibration/show"] = ClientError("busy", "later")
    with server.socket() as socket:
        for uptime_s in range(1, 1000):
            server.come(("state", state(uptime_s, CalibrationView.model_construct(id="ab"))))
            ask(socket, "plan/list", uptime_s)
            if len(server.link.named("calibration/show")) > 1:
                server.link.errors.clear()
            if server.bench.calibrated:
                break
        assert server.bench.calibrated == [8]
