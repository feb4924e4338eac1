"""Subscriptions: slow readers, callbacks, the end, and which document comes first."""

import logging
import threading
from types import SimpleNamespace

import pytest

from motord.client.subscription import DocumentSubscription, Subscription
from tests.support.patience import PATIENCE_S


def document(t_ns, name=""):
    return SimpleNamespace(t_ns=t_ns, name=name)


def plain(session, callback=None, kept=None):
    return Subscription(session, "key", int, callback, kept)


def test_a_reader_that_stands_still_costs_no_more_than_is_kept(session):
    numbers = plain(session, kept=3)
    for number in range(1000):
        session.sends(b"%d" % number)
    assert [numbers.get(0.0) for _ in range(4)] == [997, 998, 999, None]
    assert numbers.lost == 997


def test_a_callback_that_stands_still_holds_up_nobody(session):
    entered, go_on, taken = threading.Event(), threading.Event(), []

    def slow(number):
        taken.append(number)
        entered.set()
        assert go_on.wait(PATIENCE_S)

    with plain(session, slow, kept=2) as numbers:
        session.sends(b"0")
        assert entered.wait(PATIENCE_S)
        for number in range(1, 10):
            session.sends(b"%d" % number)
        assert numbers.lost == 7
        go_on.set()
        while len(taken) < 3:
            pass
    assert taken == [0, 8, 9]
    assert not session.declared


def test_an_error_in_a_callback_is_logged_and_the_next_item_comes(session, caplog):
    done = threading.Event()

    def callback(number):
        if number:
            done.set()
        raise ValueError("of a bug")

    with caplog.at_level(logging.ERROR, "motord"), plain(session, callback):
        session.sends(b"0")
        session.sends(b"1")
        assert done.wait(PATIENCE_S)
    assert "of a bug" in caplog.text


@pytest.mark.parametrize("how", ["get", "iterate"])
def test_who_waits_is_released_when_it_is_closed(session, how):
    numbers, outcome = plain(session), []
    wait = numbers.get if how == "get" else lambda: list(numbers)
    waiting = threading.Thread(target=lambda: outcome.append(wait()))
    waiting.start()
    numbers.close()
    waiting.join(PATIENCE_S)
    assert outcome == [None if how == "get" else []]
    numbers.close()


def test_a_callback_may_close_its_own_subscription(session):
    closed = threading.Event()

    def once(number):
        numbers.close()
        closed.set()

    numbers = plain(session, once)
    session.sends(b"1")
    assert closed.wait(PATIENCE_S)


@pytest.mark.parametrize(
    ("published_before", "asked", "published_after", "read"),
    [
        ([], 5, [6, 7], [5, 6, 7]),
        ([], 5, [3, 4, 6, 7], [5, 6, 7]),  # under way when it was asked for
        ([], 5, [5, 6], [5, 5, 6]),
        ([6], 5, [7], [6, 7]),  # answered before, arrived after
        ([4], 5, [6], [4, 5, 6]),
        ([], 5, [6, 2, 3], [5, 6, 2, 3]),  # the clock of another daemon
        ([1, 2], None, [3], [1, 2, 3]),
    ],
)
def test_no_document_comes_after_a_newer_one(
    session, published_before, asked, published_after, read
):
    documents = DocumentSubscription(session, "key", lambda content: document(int(content)))
    for t_ns in published_before:
        session.sends(b"%d" % t_ns)
    if asked is not None:
        documents.add_latest(document(asked))
    for t_ns in published_after:
        session.sends(b"%d" % t_ns)
    documents.close()
    assert [each.t_ns for each in documents] == read
