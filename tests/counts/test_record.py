"""A count goes on where it was stopped, in parts, and remembers what it found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from tests.counts.__main__ import main
from tests.counts.record import Unit, count, report, rows
from tests.counts.units import EXAMPLES, EXAMPLES_PER_UNIT, invented, random_plans

WHOLE = (1, 1)


def units(*names: str, told: list[str]) -> list[Unit]:
    def counting(name: str) -> Callable[[], Mapping[str, int]]:
        def one() -> Mapping[str, int]:
            told.append(name)
            assert name != "bad", "two lots meet"
            return {"right": 2}

        return one

    return [Unit(name, counting(name)) for name in names]


def test_what_was_counted_is_not_counted_again(tmp_path: Path) -> None:
    record = tmp_path / "new/record.jsonl"
    told: list[str] = []
    count(units("a", told=told), record, "c1", WHOLE)
    count(units("a", "b", told=told), record, "c1", WHOLE)
    assert told == ["a", "b"]
    assert "      4 right" in report(record, "c1")


def test_on_another_state_of_the_code_everything_is_counted_anew(tmp_path: Path) -> None:
    record = tmp_path / "record.jsonl"
    told: list[str] = []
    count(units("a", told=told), record, "c1", WHOLE)
    count(units("a", told=told), record, "c2", WHOLE)
    assert told == ["a", "a"]
    assert set(rows(record, "c2")) == {"a"}


def test_the_parts_of_a_count_are_all_of_it_and_no_unit_twice(tmp_path: Path) -> None:
    record = tmp_path / "record.jsonl"
    told: list[str] = []
    for first in (1, 2, 3):
        count(units(*"abcdefg", told=told), record, "c1", (first, 3))
    assert sorted(told) == list("abcdefg")


def test_a_fault_is_written_down_and_the_rest_is_counted_all_the_same(tmp_path: Path) -> None:
    record = tmp_path / "record.jsonl"
    told: list[str] = []
    assert count(units("bad", "good", told=told), record, "c1", WHOLE) == 1
    assert told == ["bad", "good"]
    assert "bad: two lots meet" in report(record, "c1")
    assert count(units("bad", "good", told=told), record, "c1", WHOLE) == 1


def test_a_line_that_was_cut_off_is_counted_again(tmp_path: Path) -> None:
    record = tmp_path / "record.jsonl"
    told: list[str] = []
    count(units("a", told=told), record, "c1", WHOLE)
    record.write_text(record.read_text("utf-8")[:20], "utf-8")
    count(units("a", "b", told=told), record, "c1", WHOLE)
    assert told == ["a", "a", "b"]
    count(units("a", "b", told=told), record, "c1", WHOLE)
    assert told == ["a", "a", "b"]


def test_each_seed_has_rigs_and_examples_of_its_own() -> None:
    for of in (invented, random_plans):
        first, second = ({unit.name for unit in of(seed)} for seed in (0, 1))
        assert not first & second
    assert len(list(random_plans(0))) * EXAMPLES_PER_UNIT == EXAMPLES


def test_one_rig_of_a_seed_is_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = tmp_path / "record.jsonl"
    asked = ["invented", "--part", "1/200", "--record", str(record)]
    assert main(asked) == 0
    assert main([*asked, "--report"]) == 0
    said = capsys.readouterr().out
    assert said.count("1 units, 0 at fault") == 2
    assert "requests" in said
    with pytest.raises(SystemExit):
        main(["invented", "--part", "3/2"])
