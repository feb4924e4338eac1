"""Work done some steps ahead."""

import threading

import pytest

from motord.record.ahead import ahead


def threads() -> int:
    return sum(thread.name.startswith("ahead") for thread in threading.enumerate())


@pytest.mark.parametrize("count", [0, 1, 2, 30])
def test_results_come_in_order(count):
    assert list(ahead(lambda n: n * n, range(count))) == [n * n for n in range(count)]
    assert threads() == 0


def test_no_more_than_a_few_items_are_ahead():
    begun = []
    results = ahead(begun.append, range(1000))
    next(results)
    results.close()
    assert 1 <= len(begun) < 10
    assert threads() == 0


def test_what_the_work_raises_is_raised_in_its_turn():
    results = ahead(lambda n: 1 // (3 - n), range(10))
    assert [next(results), next(results), next(results)] == [0, 0, 1]
    with pytest.raises(ZeroDivisionError):
        next(results)
    assert threads() == 0
