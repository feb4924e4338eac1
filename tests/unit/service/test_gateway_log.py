"""What Zenoh's log says of refusals, as messages: lines as Zenoh 1.10 writes them."""

from hypothesis import given
from hypothesis import strategies as st

from motord.service.gateway.audit import AuditLog, Throttle

ACCESS = "zenoh::net::routing::interceptor::access_control"
ZID = "babe5e813b1ed6c2ad9d0447f6d553f5"
BEN = f"{ZID} on Interface(lo)+CertCommonName(ben)+Transport(Tls)+{ZID} is "


def line(text, level="TRACE", target=ACCESS, thread="ThreadId(08)"):
    return (
        f"\x1b[2m2026-11-21T04:33:50.073002Z\x1b[0m \x1b[35m{level}\x1b[0m  rx-0 {thread} "
        f"\x1b[2m{target}\x1b[0m\x1b[2m:\x1b[0m {text}\n"
    )


def log():
    return AuditLog({"ben": "viewer", "anna": "operator"})


def test_a_denied_query_is_reported():
    refused = log().read(line(BEN + "unauthorized to Query (ingress) on motord/b/rpc/stop"))
    assert refused.message == "refused: ben (viewer) may not ask for motord/b/rpc/stop"
    assert refused.data["who"] == "ben"


def test_what_is_allowed_or_goes_out_is_not():
    for text in ("authorized to Query (ingress) on k", "unauthorized to Put (egress) on k"):
        assert log().read(line(BEN + text)) is None
    assert log().read("something else\n") is None
    assert log().read(line("Access control is enabled", "DEBUG")) is None


def test_what_zenoh_works_out_in_advance_is_no_attempt():
    reads = log()
    reads.read(line("ACL (ingress): caching permissions for `motord/b/state` ..."))
    for what in range(9):
        text = BEN + f"unauthorized to Action{what} (ingress) on motord/b/state"
        assert reads.read(line(text)) is None
        assert reads.read(line(BEN + "unauthorized to Put (ingress) on x", thread="ThreadId(2)"))
    attempted = BEN + "unauthorized to Put (ingress) on motord/b/state"
    assert reads.read(line(attempted)).data["action"] == "Put"


def test_a_cached_denial_is_reported_with_the_name_known_before():
    reads = log()
    cached = f"Using cached result: {ZID} is unauthorized to Query (ingress) on k"
    assert "somebody (no role)" in reads.read(line(cached)).message
    reads.names[ZID] = "ben"
    assert reads.read(line(cached)).message == "refused: ben (viewer) may not ask for k"


def test_failed_handshakes_are_reported_with_their_reason():
    for text, reason in (
        ("peer sent no certificates", "it showed no certificate"),
        ("invalid peer certificate: UnknownIssuer", "its certificate is from another authority"),
        ("invalid peer certificate: certificate expired: x", "its certificate has expired"),
        ("received corrupt message of type X", "it does not speak TLS"),
        ("something new", "something new"),
    ):
        entry = line(f"{text}. Hint: increase the limit.", "WARN", "zenoh_link_tls::unicast")
        assert log().read(entry).message == f"refused a connection: {reason}"


@given(st.lists(st.text()))
def test_no_line_is_too_odd(texts):
    reads = log()
    for text in texts:
        reads.read(text)
        reads.read(line(text))


def test_the_same_is_said_once_in_a_while_and_counted():
    throttle = Throttle()
    assert throttle.pass_on("a", 0) == "a"
    assert [throttle.pass_on("a", n) for n in range(1, 4)] == [None] * 3
    assert throttle.pass_on("a", Throttle.AGAIN_NS) == "a (3 more times before)"
    assert throttle.pass_on("a", 2 * Throttle.AGAIN_NS) == "a"


def test_no_flood_of_different_messages():
    throttle = Throttle()
    passed = [throttle.pass_on(str(n), 0) for n in range(1000)]
    assert sum(p is not None for p in passed) == Throttle.MOST
    assert throttle.pass_on("later", Throttle.AGAIN_NS) == "later"
