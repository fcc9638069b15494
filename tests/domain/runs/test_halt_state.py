"""What an aborted run wants of each device that it has used."""

from __future__ import annotations

from uuid import UUID

import pytest

from labweb.domain.runs.halts.halt_progress import HaltState, Set, halt_wish

MINE, OTHER, ENDED = UUID(int=1), UUID(int=2), UUID(int=3)
OURS = Set(run_id=MINE, is_live=False)
THEIRS = Set(run_id=OTHER, is_live=True)
LEFT = Set(run_id=ENDED, is_live=False)


@pytest.mark.parametrize(
    ("asked", "standing", "acts", "may_stand", "wish"),
    [
        (set(), [], False, False, None),
        (set(), [], True, False, HaltState.ASKED),
        (set(), [THEIRS], True, False, HaltState.ASKED),
        (set(), [OURS], False, False, HaltState.ASKED),
        (set(), [], False, True, HaltState.ASKED),
        (set(), [THEIRS], False, False, None),
        (set(), [LEFT], False, False, None),
        (set(), [OURS, LEFT], False, False, HaltState.ASKED),
        (set(), [OURS, THEIRS], False, False, HaltState.KEPT),
        (set(), [THEIRS], False, True, HaltState.KEPT),
        ({HaltState.KEPT}, [OURS, THEIRS], False, False, None),
        ({HaltState.KEPT}, [OURS], False, False, HaltState.ASKED),
        ({HaltState.ASKED}, [OURS], True, False, None),
        ({HaltState.OWED}, [OURS], True, False, None),
        ({HaltState.HALTED}, [], True, False, None),
        ({HaltState.HALTED}, [OURS], True, False, HaltState.ASKED),
        ({HaltState.LOST}, [OURS], False, False, HaltState.ASKED),
    ],
)
def test_a_device_is_halted_unless_it_works_for_another_run(
    asked: set[HaltState],
    standing: list[Set],
    acts: bool,
    may_stand: bool,
    wish: HaltState | None,
) -> None:
    assert halt_wish(MINE, asked, standing, acts=acts, may_stand=may_stand) is wish
