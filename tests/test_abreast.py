import os
import threading
import time

import pytest

from hairfit.abreast import MOST, abreast


def test_results_come_in_the_order_of_what_was_given():
    def slow_first(number, word):
        time.sleep(0.02 / (1 + number))
        return f"{number} {word}"

    words = ["to", "be", "or", "not", "to", "be", "that", "is", "the", "question"]
    found = list(abreast(slow_first, range(len(words)), words))
    assert found == [f"{number} {word}" for number, word in enumerate(words)]
    assert list(abreast(slow_first, [], [])) == []


def test_two_are_at_work_at_once(monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    both = threading.Barrier(2)
    # Each waits for the other: one after the other they would wait for ever.
    found = list(abreast(lambda k: both.wait(timeout=10.0) >= 0 and k, [1, 2]))
    assert found == [1, 2]


def test_little_is_done_ahead_of_what_is_taken(monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    begun = []
    found = abreast(begun.append, range(100))
    next(found)
    assert len(begun) <= MOST + 1
    found.close()
    assert len(begun) <= MOST + 1


def test_an_error_is_raised_where_its_result_would_have_been():
    def third_fails(number):
        if number == 2:
            raise ValueError("no hair")
        return number

    found = abreast(third_fails, range(5))
    assert [next(found), next(found)] == [0, 1]
    with pytest.raises(ValueError, match="no hair"):
        next(found)


def test_columns_of_other_lengths_are_refused():
    with pytest.raises(ValueError, match="shorter"):
        list(abreast(lambda a, b: a + b, [1, 2, 3], [1, 2]))
