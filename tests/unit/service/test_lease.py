"""The lease against a model: never two commanders, never one who was silent too long."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, rule

from motord.service.lease import Lease
from motord.service.refusal import Refusal

DURATION_NS = 2_000_000_000
HOLDERS = st.sampled_from(["anna", "ben", "cli"])


class LeaseModel(RuleBasedStateMachine):
    """What the lease should do, told as simply as possible."""

    tokens = Bundle("tokens")

    def __init__(self) -> None:
        super().__init__()
        self.now_ns = 0
        self.lease = Lease(2.0)
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
            with pytest.raises(Refusal, match=self.holder) as caught:
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
            with pytest.raises(Refusal) as caught:
                self.lease.renew(token, self.now_ns)
            assert caught.value.code == "no_lease"

    @rule(token=tokens)
    def release(self, token):
        if self._accepted(token):
            assert self.lease.release(token, self.now_ns) == self.holder
            self.token = None
        else:
            with pytest.raises(Refusal):
                self.lease.release(token, self.now_ns)

    @rule(token=st.text(max_size=40))
    def guess(self, token):
        with pytest.raises(Refusal):
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


@given(forced=st.integers(1, 5))
def test_tokens_are_never_used_twice(forced):
    lease = Lease(1.0)
    tokens = [lease.acquire("a", 0, force=True).token for _ in range(forced)]
    assert len(set(tokens)) == forced
    for old in tokens[:-1]:
        with pytest.raises(Refusal):
            lease.require(old, 0)


def test_a_lost_lease_says_how_it_was_lost():
    lease = Lease(1.0)
    old = lease.acquire("anna", 0).token
    lease.acquire("ben", 0, force=True)
    with pytest.raises(Refusal, match="ben took over"):
        lease.renew(old, 0)
    newer = lease.acquire("cli", 0, force=True).token
    lease.expire(1_000_000_000, 0)
    with pytest.raises(Refusal, match="ran out"):
        lease.renew(newer, 1_000_000_001)
    given_back = lease.acquire("dora", 2_000_000_000).token
    lease.release(given_back, 2_000_000_000)
    with pytest.raises(Refusal, match="given back"):
        lease.renew(given_back, 2_000_000_000)


def test_a_lease_is_lost_so_long_before_its_end_as_the_torque_takes_to_go():
    lease = Lease(1.0)
    token = lease.acquire("anna", 0).token
    assert lease.expire(599_999_999, 400_000_000) is None
    lease.renew(token, 599_999_999)
    assert lease.expire(1_199_999_998, 400_000_000) is None
    with pytest.raises(Refusal, match="nobody is in command"):
        lease.renew(token, 1_199_999_999)
    assert lease.expire(1_199_999_999, 400_000_000) == "anna"
    with pytest.raises(Refusal, match="ran out"):
        lease.renew(token, 1_199_999_999)
