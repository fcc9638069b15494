"""What came of an action, written down again and again while the disk refuses: matter has moved."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from labweb.domain.clock_and_ids import Clock
from labweb.domain.crutd.pre_and_postconditions import Condition, ConditionResult
from labweb.domain.messages.commands import Do
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.host_actions import action_execution
from labweb.domain.runs.host_actions.action_execution import Started
from labweb.domain.runs.host_journal.action_states import ActionReport, HostScene
from labweb.domain.runs.host_journal.journal_rows import ActionRow, JournalError
from workers.base import faults
from workers.base.disk_space import is_short
from workers.journal.journal import Journal

T = TypeVar("T")

log = logging.getLogger(__name__)

LAST_WRITE_TRIES = 60
"""How often the outcome of an action is written again while the disk refuses it; the tries on a
disk without room are not counted."""

LAST_WRITE_PAUSE_S = 0.5


@dataclass(frozen=True, slots=True)
class FollowingAction:
    """The next action of a device, and what its worker knows of it before it starts."""

    row: ActionRow
    do: Do
    scene: HostScene
    meanwhile: Callable[[], None]
    """Is called when all is ready for the disk, which takes its time."""


class OutcomeRecord:
    """Writes answers and ends to the journal.

    Every method raises JournalError when the disk has refused to the last, or when another
    process was faster; a disk that is full is waited for. The action is then found
    in doubt at the next start.
    """

    def __init__(self, journal: Journal, clock: Clock) -> None:
        self._journal = journal
        self._clock = clock

    def write_answer(self, row: ActionRow, report: ActionReport, context: dict[str, Any]) -> None:
        """Write that the device has answered; what follows only reads."""
        self._persist(lambda: self._write_answer(row, report, context))

    def write_end(
        self,
        row: ActionRow,
        report: ActionReport,
        post: list[tuple[Condition, ConditionResult]],
        answered: dict[str, Any] | None = None,
        following: FollowingAction | None = None,
    ) -> Started | None:
        """Write the end of an action, and return `following` where it began in the same write.

        Args:
            row: The action.
            report: What its device answered.
            post: Its post-conditions with their verdicts.
            answered: The context of the answer, where that is not written yet.
            following: An action that begins in this write, if it may. Where the disk
                refuses, the end alone is tried again.
        """
        return self._persist(
            lambda: self._write_end(row, report, post, answered, following),
            lambda: self._write_end(row, report, post, answered, None),
        )

    def write_halt(self, row: ActionRow, *, is_owed: bool) -> None:
        """Write that the device was halted with its action, unless all of it was before.

        Args:
            row: The action.
            is_owed: The word was not delivered: it is to be, before anything else is done there.
        """
        self._persist(lambda: self._write_halt(row, is_owed))

    def _write_halt(self, row: ActionRow, is_owed: bool) -> None:  # noqa: FBT001 - private
        with self._journal.write(is_sealed=False) as tx:
            halted_setpoints.halt_with_action(tx, row, is_owed=is_owed)

    def _write_answer(self, row: ActionRow, report: ActionReport, context: dict[str, Any]) -> None:
        with self._journal.write(is_sealed=False) as tx:
            action_execution.write_actuated(tx, row, report, context)

    def _write_end(
        self,
        row: ActionRow,
        report: ActionReport,
        post: list[tuple[Condition, ConditionResult]],
        answered: dict[str, Any] | None,
        following: FollowingAction | None,
    ) -> Started | None:
        with self._journal.write(is_sealed=False) as tx:
            action_execution.write_end(tx, row, report, post, answered)
            faults.point("execute.before_done")
            if following is None:
                return None
            found = action_execution.start(
                tx, following.row, following.do, at=self._journal.moment(), scene=following.scene
            )
            following.meanwhile()
            return found if isinstance(found, Started) else None

    def _persist(self, write: Callable[[], T], again: Callable[[], T] | None = None) -> T:
        tries_count = 0
        while True:
            try:
                return write()
            except JournalError as error:
                # Without room it waits with what it alone knows: of a doubt a person is asked.
                tries_count += not is_short(self._journal.path.parent)
                if error.code == "journal.lost_claim" or tries_count >= LAST_WRITE_TRIES:
                    raise
                log.error("outcome is not on disk yet: %s", error)
                self._clock.wait(LAST_WRITE_PAUSE_S)
                write = again or write
