"""Pings: one at a time, and only the newest counts."""

from motord.dashboard.page.sending import PagePings

TERMS = {"interval_s": 0.2, "patience_s": 1.0}


def test_a_ping_follows_an_answer():
    pings = PagePings(0.0)
    assert pings.due(0.0, **TERMS) == 1
    assert pings.due(0.9, **TERMS) is None  # not answered yet
    assert pings.answer(1, 0.9)
    assert pings.due(0.91, **TERMS) == 2


def test_the_next_ping_waits_for_the_interval():
    pings = PagePings(0.0)
    pings.due(0.0, **TERMS)
    assert pings.answer(1, 0.01)
    assert pings.due(0.19, **TERMS) is None
    assert pings.due(0.2, **TERMS) == 2


def test_an_answer_that_is_too_late_does_not_count():
    pings = PagePings(0.0)
    pings.due(0.0, **TERMS)
    assert pings.due(1.0, **TERMS) == 2
    assert not pings.answer(1, 1.1)
    assert pings.silent_s(1.1) == 1.1
    assert pings.answer(2, 1.2)
    assert pings.silent_s(1.2) == 0.0


def test_what_was_not_asked_is_no_answer():
    pings = PagePings(0.0)
    assert not pings.answer(0, 0.1)
    pings.due(0.1, **TERMS)
    assert not pings.answer(2, 0.2)
    assert pings.answer(1, 0.2)
    assert not pings.answer(1, 0.3)
