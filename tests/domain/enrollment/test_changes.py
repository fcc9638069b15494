"""Two versions of a driver are compared line by line; putting the lines together gives each."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.enrollment.driver_source_diff import MOST_LINES, ModuleChange, compare
from labweb.domain.errors import DefinitionError

TEXT = st.lists(st.sampled_from(["", "a = 1", "b = 2", "def f():", "    return"]), max_size=40)


def only(before: str, after: str) -> ModuleChange:
    (found,) = compare({"m": before}, {"m": after})
    return found


def test_the_same_texts_do_not_differ() -> None:
    assert compare({"m": "a\nb\n"}, {"m": "a\nb\n"}) == []


def test_a_changed_line_stands_between_three_lines_on_each_side() -> None:
    before = "".join(f"line {n}\n" for n in range(1, 21))
    found = only(before, before.replace("line 10\n", "line ten\n"))
    (hunk,) = found.hunks
    assert [line.sign for line in hunk] == ["", "", "", "-", "+", "", "", ""]
    changed = [(line.before, line.after, line.text) for line in hunk if line.sign]
    assert changed == [(10, None, "line 10"), (None, 10, "line ten")]
    assert (found.removed_count, found.added_count) == (1, 1)


def test_a_module_that_came_and_one_that_went_are_told() -> None:
    gone, new = compare({"a": "x\n"}, {"b": "y\n"})
    assert (gone.module, gone.is_gone, gone.removed_count) == ("a", True, 1)
    assert (new.module, new.is_new, new.added_count) == ("b", True, 1)


def test_a_line_feed_at_the_end_is_a_difference() -> None:
    assert [line.sign for line in only("a\nb\n", "a\nb").hunks[0]] == ["", "-", "+"]


def test_texts_that_are_too_long_are_refused() -> None:
    with pytest.raises(DefinitionError) as refusal:
        compare({"m": "\n" * MOST_LINES}, {"m": "\n"})
    assert refusal.value.code == "driver.too_long"


@given(TEXT, TEXT)
def test_every_line_of_both_is_in_its_place(before: list[str], after: list[str]) -> None:
    old, new = ("".join(f"{line}\n" for line in lines) for lines in (before, after))
    lines = [line for one in compare({"m": old}, {"m": new}) for hunk in one.hunks for line in hunk]
    assert all(before[line.before - 1] == line.text for line in lines if line.before)
    assert all(after[line.after - 1] == line.text for line in lines if line.after)
    kept = len(before) - sum(line.sign == "-" for line in lines)
    assert kept == len(after) - sum(line.sign == "+" for line in lines)
