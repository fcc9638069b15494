"""How far a wish to halt one device has come, and whom a device works for by then."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from enum import StrEnum
from uuid import UUID

from labweb.domain.runs.halts.halted_setpoints import (
    DEVICE_STOPPED,
    INTERRUPTED,
    RUN_ABORTED,
    STOPPED,
    WITH_ACTION,
)

_HALTS = frozenset({STOPPED, WITH_ACTION, INTERRUPTED, RUN_ABORTED, DEVICE_STOPPED})


def is_off_since(halted_by: str) -> bool:
    """Say whether the device of a completed action was brought to its safe state since then.

    A set-point that was lost may stand elsewhere: somebody has turned the knob up. The same holds
    for what a person goes on without.

    Args:
        halted_by: Why the action counts as undone; empty: it does not.
    """
    return halted_by in _HALTS


class HaltState(StrEnum):
    """How far a wish to halt one device has come."""

    ASKED = "asked"
    """Sent; its host has not answered."""

    TAKEN = "taken"
    """Its host has it on disk, and delivers it."""

    OWED = "owed"
    """It could not be delivered yet, and is as soon as its device or its host answers."""

    HALTED = "halted"
    """Delivered. The message says whether the device was seen to stand."""

    KEPT = "kept"
    """Not asked for: the device works for another run."""

    LOST = "lost"
    """Its host is given up, or serves it no more: a person has to look at the device."""


UNDECIDED = frozenset({HaltState.ASKED, HaltState.TAKEN})
"""Nothing is known yet of what came of it."""

OPEN_HALTS = UNDECIDED | {HaltState.OWED}
"""Nothing is sent to the device before it is delivered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Set:
    """A completed action that left something going which still goes, as the server knows it."""

    run_id: UUID
    is_live: bool
    """Its run has not ended."""


def who_keeps(run_id: UUID, standing: Iterable[Set]) -> UUID | None:
    """Return another live run that a device works for; None: its halt is nobody else's loss.

    Args:
        run_id: The run that is aborted.
        standing: All that goes on at the device by now.
    """
    others = (one for one in standing if one.is_live and one.run_id != run_id)
    return next((one.run_id for one in others), None)


def halt_wish(
    run_id: UUID,
    asked: Collection[HaltState],
    standing: Collection[Set],
    *,
    acts: bool,
    may_stand: bool,
) -> HaltState | None:
    """Say what an aborted run wants of one of its devices.

    What acts for the run is halted whoever else works there. What the run has only left going
    is halted unless another live run works with the device; that it was left is written down
    once. Nothing is asked for twice while it is open.

    Args:
        run_id: The run that is aborted.
        asked: How far each halt has come that was asked for in its name already.
        standing: All that goes on at the device by now.
        acts: A job of the run acts at the device, or nobody knows whether it does.
        may_stand: A job of the run that was given up may have left the device going.

    Returns:
        `ASKED`: halt it. `KEPT`: note that it is left alone. None: neither.
    """
    if acts and not asked:
        return HaltState.ASKED
    if not may_stand and all(one.run_id != run_id for one in standing):
        return None
    if who_keeps(run_id, standing) is not None:
        return None if HaltState.KEPT in asked else HaltState.KEPT
    return HaltState.ASKED if OPEN_HALTS.isdisjoint(asked) else None
