"""The tables of groups and of common substances, against what their numbers say of themselves."""

from __future__ import annotations

import re

import pytest

from labweb.domain.resources.compatibility_table import CONFLICTS, STREAMS
from labweb.domain.resources.substances_table import SUBSTANCES


def test_every_pair_is_of_two_groups_and_stands_there_once() -> None:
    pairs = [frozenset(row[:2]) for row in CONFLICTS]
    assert len(set(pairs)) == len(pairs)
    assert all(pair <= STREAMS.keys() and len(pair) == 2 for pair in pairs)
    assert all(outcome and source for _, _, outcome, source in CONFLICTS)


@pytest.mark.parametrize("row", SUBSTANCES, ids=lambda row: row[2])
def test_a_substance_has_numbers_that_check_and_groups_that_are_known(
    row: tuple[str, str, str, bool, str],
) -> None:
    cas, inchikey, _, _, groups = row
    digits = cas.replace("-", "")
    total = sum(place * int(digit) for place, digit in enumerate(reversed(digits[:-1]), start=1))
    assert re.fullmatch(r"[1-9]\d{1,6}-\d\d-\d", cas)
    assert total % 10 == int(digits[-1])
    assert not inchikey or re.fullmatch(r"[A-Z]{14}-[A-Z]{8}SA-[A-Z]", inchikey)
    assert groups
    assert set(groups.split()) <= STREAMS.keys()


def test_no_two_substances_share_a_number() -> None:
    for column in (0, 1, 2):
        values = [row[column] for row in SUBSTANCES if row[column]]
        assert len(set(values)) == len(values)
