"""The lease against a model: never two commanders, never one who was silent too long."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, rule

from motord.api.errors import RpcError
from motord.service.bench.lease import CommandLease
from tests.support.properties import examples

DURATION_NS = 2_000_000_000
HOLDERS = st.sampled_from(["anna", "ben", "cli"])


class LeaseModel(RuleBasedStateMachine):
    """What the lease should do, modelled as simply as possible."""

    tokens = Bundle("tokens")

    def __init__(self) -> None:
        super().__init__()
        self.now_ns = 0
        self.lease = CommandLease(2.0)
        self.token: str | None = None
        self.holder = ""
        self.renewed_ns = 0
        self.notice_ns = 0

    @property
    def in_force(self) -> bool:
        lost_ns = self.renewed_ns + DURATION_NS - self.notice_ns
        return self.token is not None and self.now_ns < lost_ns

    @rule(seconds=st.sampled_from([0.0, 0.5, 1.999999999, 2.0, 2.5]))
    def wait(self, seconds):
        self.now_ns += round(seconds * 1e9)

    @rule(target=tokens, holder=HOLDERS, force=st.booleans())
    def acquire(self, holder, force):
        if self.in_force and not force:
            with pytest.raises(RpcError, match=self.holder) as caught:
                self.lease.acquire(holder, self.now_ns)
            assert caught.value.code == "lease_held"
            return self.token
        before = self.holder if self.in_force else None
        grant = self.lease.acquire(holder, self.now_ns, force=force)
        assert grant.took_over_from == before
        self.token, self.holder, self.renewed_ns = grant.token, holder, self.now_ns
        return grant.token

    def _accepted(self, token):
        return self.in_force and token == self.token

    @rule(token=tokens)
    def renew(self, token):
        if self._accepted(token):
            self.lease.renew(token, self.now_ns)
            self.renewed_ns = self.now_ns
        else:
            with pytest.raises(RpcError) as caught:
                self.lease.renew(token, self.now_ns)
            assert caught.value.code == "no_lease"

    @rule(token=tokens)
    def release(self, token):
        if self._accepted(token):
            assert self.lease.release(token, self.now_ns) == self.holder
            self.token = None
        else:
            with pytest.raises(RpcError):
                self.lease.release(token, self.now_ns)

    @rule(token=st.text(max_size=40))
    def guess(self, token):
        with pytest.raises(RpcError):
            self.lease.require(token, self.now_ns)

    @rule(notice_s=st.sampled_from([0.0, 0.5, 0.85]))
    def expire(self, notice_s):
        self.notice_ns = round(notice_s * 1e9)
        ran_out = self.token is not None and not self.in_force
        lost = self.lease.expire(self.now_ns, self.notice_ns)
        assert lost == (self.holder if ran_out else None)
        if ran_out:
            self.token = None
        assert self.lease.expire(self.now_ns, self.notice_ns) is None

    @invariant()
    def says_who(self):
        assert self.lease.holder(self.now_ns) == (self.holder if self.in_force else None)
        left_s = self.lease.remaining_s(self.now_ns)
        lost_ns = self.renewed_ns + DURATION_NS - self.notice_ns
        expected = (lost_ns - self.now_ns) / 1e9 if self.in_force else 0.0
        assert left_s == pytest.approx(expected)


TestLease = LeaseModel.TestCase
TestLease.settings = settings(max_examples=examples(60), stateful_step_count=25)


@given(forced=st.integers(1, 5))
def test_tokens_are_never_used_twice(forced):
    lease = CommandLease(1.0)
    tokens = [lease.acquire("a", 0, force=True).token for _ in range(forced)]
    assert len(set(tokens)) == forced
    for old in tokens[:-1]:
        with pytest.raises(RpcError):
            lease.require(old, 0)


def test_a_lost_lease_says_how_it_was_lost():
    lease = CommandLease(1.0)
    old = lease.acquire("anna", 0).token
    lease.acquire("ben", 0, force=True)
    with pytest.raises(RpcError, match="ben took over"):
        lease.renew(old, 0)
    newer = lease.acquire("cli", 0, force=True).token
    lease.expire(1_000_000_000, 0)
    with pytest.raises(RpcError, match="ran out"):
        lease.renew(newer, 1_000_000_001)
    given_back = lease.acquire("dora", 2_000_000_000).token
    lease.release(given_back, 2_000_000_000)
    with pytest.raises(RpcError, match="given back"):
        lease.renew(given_back, 2_000_000_000)


def test_a_lease_is_lost_so_long_before_its_end_as_the_torque_takes_to_go():
    lease = CommandLease(1.0)
    token = lease.acquire("anna", 0).token
    assert lease.expire(599_999_999, 400_000_000) is None
    lease.renew(token, 599_999_999)
    assert lease.expire(1_199_999_998, 400_000_000) is None
    with pytest.raises(RpcError, match="nobody is in command"):
        lease.renew(token, 1_199_999_999)
    assert lease.expire(1_199_999_999, 400_000_000) == "anna"
    with pytest.raises(RpcError, match="ran out"):
        lease.renew(token, 1_199_999_999)


def test_refusals_say_who_is_in_command_and_for_how_long():
    lease = CommandLease(2.0)
    for token in ("guessed", ""):  # "": of a plan that is started without one
        with pytest.raises(RpcError) as nobody:
            lease.require(token, 0)
        assert (nobody.value.code, str(nobody.value)) == (
            "no_lease",
            "this is not the token of the lease in force (nobody is in command)",
        )
    lease.acquire("anna", 0)
    with pytest.raises(RpcError) as held:
        lease.acquire("ben", 500_000_000)
    assert held.value.code == "lease_held"
    assert str(held.value) == (
        "anna is in command, for another 1.5 s unless renewed; wait, or take over with force"
    )
    with pytest.raises(RpcError, match=r"the lease in force \(anna is in command\)"):
        lease.renew("guessed", 0)
    assert lease.remaining_s(500_000_000) == 1.5


def test_a_lease_ends_to_the_nanosecond():
    lease = CommandLease(2.0)
    token = lease.acquire("anna", 7).token
    assert lease.duration_ns == 2_000_000_000
    assert lease.holder(2_000_000_006) == "anna"
    assert lease.remaining_s(2_000_000_006) == 1e-9
    assert lease.expire(2_000_000_006, 0) is None
    assert lease.holder(2_000_000_007) is None
    assert lease.remaining_s(2_000_000_007) == 0.0
    with pytest.raises(RpcError):
        lease.require(token, 2_000_000_007)
    grant = lease.acquire("ben", 2_000_000_007)
    assert (grant.holder, grant.took_over_from) == ("ben", None)


def test_a_lease_that_was_given_back_is_free_and_its_token_worth_nothing():
    lease = CommandLease(2.0)
    token = lease.acquire("anna", 0).token
    assert lease.release(token, 1) == "anna"
    assert lease.holder(1) is None
    assert lease.expire(10_000_000_000, 0) is None
    with pytest.raises(RpcError) as over:
        lease.release(token, 1)
    assert (over.value.code, str(over.value)) == (
        "no_lease",
        "this lease is over: it was given back",
    )


def test_tokens_are_secrets_of_128_bits():
    tokens = {CommandLease(1.0).acquire("anna", 0).token for _ in range(50)}
    assert len(tokens) == 50
    assert {len(bytes.fromhex(token)) for token in tokens} == {16}


def test_taking_over_says_from_whom():
    lease = CommandLease(1.0)
    first = lease.acquire("anna", 0, force=True)
    second = lease.acquire("ben", 0, force=True)
    assert (first.took_over_from, second.took_over_from) == (None, "anna")
    with pytest.raises(RpcError) as lost:
        lease.require(first.token, 0)
    assert str(lost.value) == "this lease is over: ben took over command"
    lease.acquire("anna", 0, force=True)
    with pytest.raises(RpcError, match="anna took over"):
        lease.renew(second.token, 0)
