"""Two actions that begin at the same moment, as a line waits for the other one.

Two lines are two processes, which know of each other by the journal alone: the one that receives
writes there that its action is ready, and the one that gives then starts both in one write.
"""

from __future__ import annotations

from collections.abc import Callable

from labweb.domain.clock_and_ids import Clock
from labweb.domain.runs.host_actions import action_execution
from labweb.domain.runs.host_actions.action_execution import Started
from labweb.domain.runs.host_journal import action_states, paired_actions
from labweb.domain.runs.host_journal.action_states import FINAL, ActionState, HostAnswer
from labweb.domain.runs.host_journal.journal_rows import ActionRow, JournalError
from labweb.domain.runs.host_journal.paired_actions import PairStand
from workers.journal.journal import Journal
from workers.line.action_watchdog import AbandonedActionError

POLL_S = 0.01


def meet(
    journal: Journal,
    row: ActionRow,
    scene: action_states.HostScene,
    clock: Clock,
    *,
    wake: Callable[[], None],
    is_over: Callable[[], bool],
) -> HostAnswer | Started:
    """Wait for the action of another line that begins at the same moment.

    Args:
        journal: The journal.
        row: The action, which waits for the other one.
        scene: What is known of it.
        clock: Says how long is waited.
        wake: Wakes the other line.
        is_over: The process is to end.

    Returns:
        The right to act, whose start is sealed; or why not: the other line was not ready in time,
        something speaks against the start by now, or the other action is of the same line.

    Raises:
        AbandonedActionError: The disk refuses. That this action is ready may stand on it, so that
            the process has to end: the next one takes it back.

    Effect:
        On the record only.
    """
    try:
        wake()
        if other_here(journal, row) is not None:
            return HostAnswer(
                action_states.HOLD, paired_actions.WAITS, "the other action is tried next"
            )
        return _meet(journal, row, scene, clock, is_over=is_over)
    except JournalError as error:
        raise AbandonedActionError(row.line) from error


def _meet(
    journal: Journal,
    row: ActionRow,
    scene: action_states.HostScene,
    clock: Clock,
    *,
    is_over: Callable[[], bool],
) -> HostAnswer | Started:
    partner_id = paired_actions.partner_of(row.do)
    until_s = clock.monotonic_s() + paired_actions.READY_S
    found = HostAnswer(
        action_states.HOLD,
        paired_actions.WAITS,
        "what begins at the same moment was not ready in time",
    )
    while partner_id is not None and clock.monotonic_s() < until_s and not is_over():
        partner = journal.action(partner_id)
        if partner is None or partner.st in FINAL or partner.st is ActionState.IN_DOUBT:
            break
        if not paired_actions.gives(row, partner):
            if journal.state_of(row.action_id) is not ActionState.ACCEPTED:
                break
        elif paired_actions.readiness(partner, journal.moment()) is not None:
            with journal.write() as tx:
                told = action_execution.start_both(
                    tx, row, row.do, at=journal.moment(), scene=scene
                )
            if isinstance(told, Started) or told.code != paired_actions.WAITS:
                return told
        clock.wait(POLL_S)
    with journal.write() as tx:
        if not paired_actions.withdraw(tx, row):
            return found
    # Whoever started it may not have moved the seal yet.
    journal.seal_up()
    with journal.write() as tx:
        now = tx.action(row.action_id)
        other = None if partner_id is None else tx.action(partner_id)
        if now is None or paired_actions.may_act(now, other):
            return Started(row, row.do)
        action_execution.write_end(tx, now, paired_actions.not_sent(), [])
    return HostAnswer(action_states.REJECT, "edge.partner", "the action that it meets has failed")


def leave(journal: Journal, line: str) -> None:
    """Write down, after the process of a line has ended, that none of its pairs is served."""
    started = journal.actions(line, ActionState.STARTED)
    waiting = journal.actions(line, ActionState.ACCEPTED)
    if any(paired_actions.partner_of(row.do) for row in (*started, *waiting)):
        with journal.write() as tx:
            paired_actions.leave(tx, waiting, started)


def other_here(journal: Journal, row: ActionRow) -> ActionRow | None:
    """Return the action that begins at the same moment, where it is of the same line."""
    partner_id = paired_actions.partner_of(row.do)
    found = None if partner_id is None else journal.action(partner_id)
    return None if found is None or found.line != row.line else found


def giver_here(journal: Journal, row: ActionRow, answer: HostAnswer) -> ActionRow | None:
    """Return the giver of the same line, for which an action that is ready to receive waits."""
    other = other_here(journal, row) if answer.code == paired_actions.WAITS else None
    return other if other is not None and paired_actions.gives(other, row) else None


def waits_for_own(journal: Journal, row: ActionRow) -> bool:
    """Say whether another action of the same line has to be confirmed first."""
    other = other_here(journal, row)
    return other is not None and paired_actions.stand(row, other) is PairStand.WAIT


def await_partner(
    journal: Journal, row: ActionRow, clock: Clock, *, is_over: Callable[[], bool]
) -> PairStand:
    """Wait until it is known how the other action stands.

    Returns:
        WAIT when `is_over` cut that short, or when the other is of this line and not confirmed.
    """
    partner_id = paired_actions.partner_of(row.do)
    if partner_id is None:
        return PairStand.GO_ON
    is_own = other_here(journal, row) is not None
    while True:
        found = paired_actions.stand(row, journal.action(partner_id))
        if found is not PairStand.WAIT or is_own or is_over():
            return found
        clock.wait(POLL_S)
