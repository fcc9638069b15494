"""What is seen of a line's action from another thread, and done about it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from uuid import UUID

from labweb.domain.clock_and_ids import Clock
from labweb.domain.messages.commands import Do
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.domain.runs.host_journal.journal_rows import ActionRow, JournalError
from workers.journal.journal import Journal
from workers.line.action_execution import ActionExecution, ActionResult
from workers.line.device_unit import DeviceUnit
from workers.line.outcome_record import OutcomeRecord

log = logging.getLogger(__name__)


class HungDriverError(RuntimeError):
    """A driver did not come back. Its process has to end; the journal knows all."""


class AbandonedActionError(RuntimeError):
    """An action was started, and nothing will write its answer down any more.

    Its process has to end: the next one finds the action and puts it in doubt.
    """


class ActionWatchdog:
    """Looks whether an action has to be halted, and ends one whose driver hangs."""

    def __init__(
        self, journal: Journal, clock: Clock, wake_others: Callable[[Journal, Do], None]
    ) -> None:
        """Watch over what is carried out here.

        Args:
            journal: The journal of the line's own thread; another hold on it is taken once it is
                needed.
            clock: Says when an action's time is over.
            wake_others: Is told of an action that was ended here.
        """
        self._known = journal
        self._clock = clock
        self._wake_others = wake_others
        self._journal: Journal | None = None
        self._acts: tuple[ActionExecution, ...] = ()
        self._has_failed = False
        """One of several that act at the same moment has failed: the others are halted."""

    def close(self) -> None:
        """Let go of the journal."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def carry_out(self, unit: DeviceUnit, row: ActionRow) -> ActionResult:
        """Carry an action out on this thread; `look` may be called on another one meanwhile.

        Raises:
            HungDriverError: It was given up, and that is written down.

        Effect:
            The device acts, once.
        """
        return self.carry_out_all([(unit, row)])[0]

    def carry_out_all(self, pairs: Sequence[tuple[DeviceUnit, ActionRow]]) -> list[ActionResult]:
        """Carry out actions that begin at the same moment, the first of them on this thread.

        When one fails the others are halted.

        Raises:
            HungDriverError: One was given up, and that is written down.

        Effect:
            Each device acts, once.
        """
        acts = tuple(ActionExecution(unit, row, self._clock) for unit, row in pairs)
        found: list[ActionResult | None] = [None] * len(acts)
        self._acts, self._has_failed = acts, False

        def carry_out(place: int) -> None:
            acted = found[place] = acts[place].carry_out()
            self._has_failed = self._has_failed or acted is None or not acted.report.ok

        others = [
            threading.Thread(target=carry_out, args=(place,), name="line-action", daemon=True)
            for place in range(1, len(acts))
        ]
        for other in others:
            other.start()
        carry_out(0)
        for other in others:
            other.join()
        self._acts = ()
        hung = [unit.config.key for (unit, _), acted in zip(pairs, found, strict=True) if not acted]
        if hung:
            raise HungDriverError(", ".join(hung))
        return [acted for acted in found if acted is not None]

    def look(self) -> None:
        """Halt the device of what acts now, if it has to be.

        Raises:
            HungDriverError: Its driver hangs; the action is in doubt, the process has to end.
            AbandonedActionError: Nobody can look after the action any more.
        """
        for act in self._acts:
            self._look(act)

    def _look(self, act: ActionExecution) -> None:
        try:
            report = act.look(lambda: self._is_cancelled(act.row.action_id))
            if report is not None:
                self._end(act, report)
        except Exception as error:
            raise AbandonedActionError(act.row.line) from error
        if report is not None:
            raise HungDriverError(act.unit.config.key)

    def _end(self, act: ActionExecution, report: ActionReport) -> None:
        """Write the end of an action in place of its line's thread, which does not come back."""
        journal = self._hold()
        outcomes = OutcomeRecord(journal, self._clock)
        if act.unit.driver.is_stopped:
            # And stays so: the driver may still be in its call. Whether its device heard the word,
            # nobody has seen: the process that follows halts it again, and looks.
            outcomes.write_halt(act.row, is_owed=True)
        outcomes.write_end(act.row, report, [])
        self._wake_others(journal, act.row.do)

    def _is_cancelled(self, action_id: UUID) -> bool:
        """Say whether to halt; the device still acts, so that no fault may end the waiting."""
        if self._has_failed:
            return True
        try:
            row = self._hold().action(action_id)
        except JournalError as error:
            log.error("whether to cancel cannot be read: %s", error)
            return False
        return row is not None and row.is_cancel_wanted

    def _hold(self) -> Journal:
        if self._journal is None:
            known = self._known
            self._journal = Journal(known.path, wall_s=known.wall_s, mono_s=known.mono_s)
        return self._journal
