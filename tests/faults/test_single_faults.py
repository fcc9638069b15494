"""Every place of one transfer with every fault: at most once, nothing told is lost, doubt is said.

The table is read so: a pump draws 100 µL while one fault happens at one place. Then a second
process comes, on a sound disk and with a sound device. A cell says how the action ended for
good, and how often the device was made to act.

    complete 1   done once, and known; where the first process did nothing, by the second
    in_doubt 0   started and never answered: nobody can know, and here the device had not acted
    in_doubt 1   the same, and here it had
    aborted 0    the device did not answer before it was asked to move: nothing has moved
    aborted 1    it stopped within its stroke and says where: 40 µL are on record
"""

from __future__ import annotations

import ctypes
import platform

import pytest

from tests.faults import cells
from tests.faults.cells import Seen
from workers.base import fault_injection, faults

KINDS = ("kill", "raise", "disk_full", "fsync", "timeout", "partial")

TABLE = """
place                       kill        raise       disk_full   fsync       timeout     partial

accept.before_commit        complete 1  complete 1  complete 1  complete 1  complete 1  aborted 1
journal.before_commit@1     complete 1  complete 1  complete 1  complete 1  complete 1  aborted 1
journal.after_commit@1      complete 1  complete 1  complete 1  complete 1  complete 1  aborted 1
seal.before_write@1         complete 1  complete 1  complete 1  complete 1  complete 1  aborted 1
accept.after_commit         complete 1  complete 1  complete 1  complete 1  complete 1  aborted 1

execute.before_started      complete 1  complete 1  complete 1  complete 1  aborted 0   aborted 1
journal.before_commit@2     complete 1  complete 1  complete 1  complete 1  aborted 0   aborted 1
journal.after_commit@2      in_doubt 0  in_doubt 0  in_doubt 0  in_doubt 0  aborted 0   aborted 1
seal.before_write@2         in_doubt 0  in_doubt 0  in_doubt 0  in_doubt 0  aborted 0   aborted 1
execute.after_started       in_doubt 0  in_doubt 0  in_doubt 1  in_doubt 1  aborted 0   aborted 1

execute.before_first_byte   in_doubt 0  in_doubt 0  in_doubt 1  in_doubt 1  aborted 0   aborted 1
execute.after_first_byte    in_doubt 0  in_doubt 0  in_doubt 1  in_doubt 1  aborted 0   aborted 1
execute.mid_action          in_doubt 0  in_doubt 0  in_doubt 1  in_doubt 1  aborted 0   aborted 1
execute.after_first_byte@2  in_doubt 0  in_doubt 0  in_doubt 1  in_doubt 1  in_doubt 1  aborted 1
execute.mid_action@2        in_doubt 0  in_doubt 0  in_doubt 1  in_doubt 1  in_doubt 1  aborted 1
execute.after_first_byte@3  in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  aborted 1
execute.mid_action@3        in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  aborted 1
execute.after_first_byte@4  in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  aborted 1

execute.before_actuated     in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  complete 1
journal.before_commit@3     in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  in_doubt 1  complete 1
journal.after_commit@3      complete 1  complete 1  complete 1  complete 1  in_doubt 1  complete 1
execute.after_actuated      complete 1  complete 1  complete 1  complete 1  in_doubt 1  complete 1

execute.before_done         complete 1  complete 1  complete 1  complete 1  complete 1  complete 1
journal.before_commit@4     complete 1  complete 1  complete 1  complete 1  complete 1  complete 1
journal.after_commit@4      complete 1  complete 1  complete 1  complete 1  complete 1  complete 1
execute.after_done          complete 1  complete 1  complete 1  complete 1  complete 1  complete 1
"""
# 1 to 4 are the writes of accepted, started, actuated and the end; the last two leave the seal
# to whoever tells of them. Of the bytes, the second
# write after the first is the command that acts, and its answer is the third that comes in.


def rows() -> dict[str, dict[str, str]]:
    """Read the table: place, then fault, then what comes of it."""
    lines = [line.split() for line in TABLE.splitlines() if line.strip()]
    assert tuple(lines[0][1:]) == KINDS
    return {
        words[0]: {
            kind: f"{words[1 + 2 * column]} {words[2 + 2 * column]}"
            for column, kind in enumerate(KINDS)
        }
        for words in lines[1:]
    }


CELLS = [(place, kind) for place, row in rows().items() for kind in KINDS]

pytestmark = [
    pytest.mark.timeout(300),
    pytest.mark.skipif(
        platform.machine() not in fault_injection.NUMBERS
        or not hasattr(ctypes.CDLL(None), "prctl"),
        reason="disks are broken by seccomp, here on a machine without a table of its calls",
    ),
]


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], Seen]:
    return cells.play_all(CELLS, tmp_path_factory.mktemp("cells"))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("place", rows())
def test_one_fault_leaves_what_the_table_says(
    seen: dict[tuple[str, str], Seen], place: str, kind: str
) -> None:
    cell = seen[place, kind]
    assert cell.count <= 1
    assert cell.short == rows()[place][kind]
    assert cell.regression is None
    assert cell.events[: len(cell.told)] == cell.told
    assert cell.is_closed == (cell.final == "in_doubt")
    if cell.final != "in_doubt":
        assert cell.recorded_ul == pytest.approx(cell.drawn_ul, abs=0.4)
    _check_end(cell, kind)


def _check_end(cell: Seen, kind: str) -> None:
    """A crash kills, a fault of the device ends no process, and a doubt is never a guess."""
    assert cell.ended in {"kill": {"killed"}, "timeout": {"whole"}, "partial": {"whole"}}.get(
        kind, {"failed", "whole"}
    )
    if cell.final == "complete":
        assert (cell.count, cell.recorded_ul) == (1, 100.0)
    if cell.final == "in_doubt":
        assert cell.left in {"started", "in_doubt"}
        assert cell.recorded_ul == 0.0
    kinds = [event.kind for event in cell.events if event.action_id is not None]
    assert kinds.count("started") == 1
    assert kinds[0] == "accepted"
    assert kinds[-1] == cell.final


def test_the_table_names_every_place_of_accept_journal_and_executor() -> None:
    named = {place.partition("@")[0] for place in rows()}
    assert named == {place for place in faults.POINTS if not place.startswith("uplink.")}


def test_a_table_with_a_wrong_cell_would_be_seen(seen: dict[tuple[str, str], Seen]) -> None:
    outcomes = {cell.short for cell in seen.values()}
    assert outcomes == {"complete 1", "in_doubt 0", "in_doubt 1", "aborted 0", "aborted 1"}
