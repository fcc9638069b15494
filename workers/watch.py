"""What is seen of a line's action from another thread, and done about it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from uuid import UUID

from labweb.domain.messages import Do
from labweb.domain.ports import Clock
from labweb.domain.runs.edge import Report
from labweb.domain.runs.journal import ActionRow, JournalError
from workers.execute import Act, Acted
from workers.journal import Journal
from workers.outcomes import Outcomes
from workers.unit import Unit

log = logging.getLogger(__name__)


class HungDriverError(RuntimeError):
    """A driver did not come back. Its process has to end; the journal knows all."""


class AbandonedActionError(RuntimeError):
    """An action was started, and nothing will write its answer down any more.

    Its process has to end: the next one finds the action and puts it in doubt.
    """


class Watch:
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
        self._act: Act | None = None

    def close(self) -> None:
        """Let go of the journal."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def carry_out(self, unit: Unit, row: ActionRow) -> Acted:
        """Carry an action out on this thread; `look` may be called on another one meanwhile.

        Raises:
            HungDriverError: It was given up, and that is written down.

        Effect:
            The device acts, once.
        """
        self._act = act = Act(unit, row, self._clock)
        acted = act.carry_out()
        self._act = None
        if acted is None:
            raise HungDriverError(unit.config.key)
        return acted

    def look(self) -> None:
        """Halt the device of what acts now, if it has to be.

        Raises:
            HungDriverError: Its driver hangs; the action is in doubt, the process has to end.
            AbandonedActionError: Nobody can look after the action any more.
        """
        act = self._act
        if act is None:
            return
        try:
            report = act.look(lambda: self._is_cancelled(act.row.action_id))
            if report is not None:
                self._end(act, report)
        except Exception as error:
            raise AbandonedActionError(act.row.line) from error
        if report is not None:
            raise HungDriverError(act.unit.config.key)

    def _end(self, act: Act, report: Report) -> None:
        """Write the end of an action in place of its line's thread, which does not come back."""
        journal = self._hold()
        outcomes = Outcomes(journal, self._clock)
        if act.unit.driver.is_stopped:
            # And stays so: the driver may still be in its call. Whether its device heard the word,
            # nobody has seen: the process that follows halts it again, and looks.
            outcomes.write_halt(act.row, is_owed=True)
        outcomes.write_end(act.row, report, [])
        self._wake_others(journal, act.row.do)

    def _is_cancelled(self, action_id: UUID) -> bool:
        """Say whether to halt; the device still acts, so that no fault may end the waiting."""
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
