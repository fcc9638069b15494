"""How often a name may do something."""

from __future__ import annotations

import pytest

from labweb.common.limits import token_buckets
from labweb.common.limits.token_buckets import Buckets, Rate


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.at_s = 0.0

    def __call__(self) -> float:
        return self.at_s


def test_a_name_takes_its_burst_and_then_waits_for_the_rate() -> None:
    clock = Clock()
    bucket = Buckets(Rate(per_s=2, burst_count=3), clock)
    assert [bucket.take("a") for _ in range(4)] == [0, 0, 0, 0.5]
    clock.at_s = 0.5
    assert [bucket.take("a"), bucket.take("a")] == [0, 0.5]


def test_what_one_name_takes_no_other_lacks() -> None:
    bucket = Buckets(Rate(per_s=1, burst_count=1), Clock())
    assert [bucket.take("a"), bucket.take("a") > 0, bucket.take("b")] == [0, True, 0]


def test_a_refusal_takes_nothing() -> None:
    clock = Clock()
    bucket = Buckets(Rate(per_s=1, burst_count=2), clock)
    bucket.take("a", 2)
    assert all(bucket.take("a") == 1 for _ in range(50))
    clock.at_s = 1.0
    assert bucket.take("a") == 0


def test_what_costs_more_than_there_ever_is_takes_a_full_bucket() -> None:
    clock = Clock()
    bucket = Buckets(Rate(per_s=1, burst_count=4), clock)
    assert bucket.take("a", 100) == 0
    clock.at_s = 3.0
    assert bucket.take("a", 100) == 1.0


def test_made_up_names_do_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(token_buckets, "MOST_NAMES", 10)
    bucket = Buckets(Rate(per_s=1, burst_count=1), Clock())
    for number in range(1000):
        bucket.take(str(number))
    assert len(bucket._levels) == 10
