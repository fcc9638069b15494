"""How a host carries an action out: what it writes before, between and after the bytes.

`start` hands out the only `Started` there is, so nobody can act on an action whose start
is not part of a write. The order is: read, `start`, act, `write_actuated`, read, `write_end`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from uuid import UUID

from labweb.domain.crutd import operations, settlement
from labweb.domain.crutd.pre_and_postconditions import Condition, ConditionResult, Verification
from labweb.domain.crutd.settlement import Change, Outcome, OutcomeKind
from labweb.domain.errors import Effect, LabError
from labweb.domain.messages.commands import Do
from labweb.domain.runs.halts import halted_setpoints, vanished_setpoints
from labweb.domain.runs.host_actions import host_batch, host_state
from labweb.domain.runs.host_journal import action_states, paired_actions
from labweb.domain.runs.host_journal.action_states import (
    ActionReport,
    ActionState,
    Conclusion,
    HostAnswer,
)
from labweb.domain.runs.host_journal.action_states import HostScene as HostScene
from labweb.domain.runs.host_journal.event_bodies import change_body, report_body, results_body
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import ActionRow, JournalWrite
from labweb.domain.runs.host_journal.known_resources import apply_change, snapshot

_GIVEN_BACK = frozenset(
    {"edge.predecessor", "edge.partner", "edge.rebooted", "calibration.expired"}
)
"""Reasons to reject an action that may be sent again."""


@dataclass(frozen=True, slots=True)
class Started:
    """The right to send an action's bytes once, as soon as its write is on disk."""

    row: ActionRow
    do: Do


def in_turn(rows: Iterable[ActionRow]) -> Iterator[ActionRow]:
    """Give of a line's accepted actions, in dispatch order, the first of each device."""
    seen: set[UUID] = set()
    for row in rows:
        if row.device_id not in seen:
            seen.add(row.device_id)
            yield row


def age_s(row: ActionRow, at: HostMoment) -> float:
    """Return how long an action has waited since its acceptance.

    Only the monotonic clock counts, and it counts within one start of the machine. After a
    restart nobody knows how long the machine was off: no wall clock decides, so the action
    counts as too old and is given back.
    """
    if row.accepted_boot_id == at.boot_id:
        return at.mono_s - row.accepted_mono_s
    return action_states.NEVER_S


def sent_age_s(do: Do, host: action_states.HostState, at: HostMoment) -> float:
    """Return for how long at most a command has been under way and waiting since it was signed.

    Two monotonic clocks are compared, the own one and the server's, of which the session told; so
    nobody who sets a wall clock, here or there, changes it. Where the server signed on another
    machine, or was restarted since, nothing is known: 0, and the age since acceptance counts.
    """
    if do.sent is None or do.sent.clock != host.server_clock:
        return 0.0
    return max(0.0, at.mono_s + host.server_ahead_s - do.sent.at_s)


def decide_now(
    tx: JournalWrite, row: ActionRow, do: Do, at: HostMoment, results: Sequence[ConditionResult]
) -> HostAnswer:
    """Decide inside the write, so that nothing changes between decision and start."""
    if tx.state_of(row.action_id) is not ActionState.ACCEPTED:
        return HostAnswer(action_states.HOLD, "edge.taken", "the action was stopped meanwhile")
    operation = row.operation
    known = snapshot(tx, operations.touched_ids(operation))
    host = tx.host_state(at.boot_id)
    turn = host_batch.turn_of(tx, do.batch, host_state.offline_s(host, at))
    answer = action_states.decide_start(
        host,
        action_states.ActionCandidate(
            dseq=row.dseq,
            max_fence=tx.max_fence(row.device_id),
            age_s=age_s(row, at),
            ttl_s=do.ttl_s,
            numbers_hold_s=do.numbers_hold_s,
            sent_age_s=sent_age_s(do, host, at),
            device_blocked_by=tx.blocked_by(row.device_id),
            owes_halt=str(row.device_id) in host.owes_halt,
        ),
        turn=None if turn is None else host_batch.decide_turn(turn),
        findings=settlement.check(operation, known),
        results=results,
    )
    partner_id = paired_actions.partner_of(do)
    if partner_id is None or answer.kind != action_states.START:
        return answer
    return paired_actions.gone(tx.action(partner_id), row) or answer


def start(
    tx: JournalWrite, row: ActionRow, do: Do, *, at: HostMoment, scene: HostScene
) -> HostAnswer | Started:
    """Decide whether an action starts now, and write down what was decided."""
    answer = decide_now(tx, row, do, at, [result for _, result in scene.judged])
    write_rejection(tx, row, answer, scene.judged)
    if answer.kind != action_states.START:
        return answer
    return _begin(tx, row, do, scene)


def start_both(
    tx: JournalWrite, row: ActionRow, do: Do, *, at: HostMoment, scene: HostScene
) -> HostAnswer | Started:
    """Decide whether an action and the one that it meets start now, and write it down.

    Returns:
        HOLD with `edge.meets` where the giver has to wait for the receiver, or the receiver has
        told that it is ready, which it is for `paired_actions.READY_S`. Else as `start`; with the
        right to give, the receiver is started too, and its line has the right to that.
    """
    answer = decide_now(tx, row, do, at, [result for _, result in scene.judged])
    write_rejection(tx, row, answer, scene.judged)
    partner_id = paired_actions.partner_of(do)
    partner = None if partner_id is None else tx.action(partner_id)
    if answer.kind != action_states.START or partner is None:
        return answer
    if decide_now(tx, partner, partner.do, at, []).kind != action_states.START:
        return HostAnswer(action_states.HOLD, "", "what begins at the same moment may not start")
    waits = HostAnswer(
        action_states.HOLD,
        paired_actions.WAITS,
        "what begins at the same moment is not ready",
    )
    if not paired_actions.gives(row, partner):
        paired_actions.note_ready(tx, row, at, scene)
        return waits
    ready = paired_actions.readiness(partner, at)
    if ready is None:
        return waits
    started = _begin(tx, row, do, scene)
    _begin(tx, partner, partner.do, ready.scene)
    return started


def _begin(tx: JournalWrite, row: ActionRow, do: Do, scene: HostScene) -> Started:
    # Read again only where something is judged by it, should this end before that.
    kept = {"prestate": scene.prestate} if do.post else {}
    tx.move(row.action_id, ActionState.ACCEPTED, ActionState.STARTED, **kept)
    tx.raise_fence(row.device_id, row.dseq)
    body = {
        "pid": scene.pid,
        "line": row.line,
        "device_id": str(row.device_id),
        "driver_digest": scene.driver_digest,
        "epoch": row.epoch,
        "dseq": row.dseq,
        "prestate": scene.prestate,
        "pre": results_body(scene.judged),
        "context": scene.context,
    }
    tx.append("started", row.action_id, body)
    return Started(row, do)


def reject(tx: JournalWrite, row: ActionRow, answer: HostAnswer) -> None:
    """End an action that can never start, unless something else ended it first."""
    if tx.state_of(row.action_id) is ActionState.ACCEPTED:
        write_rejection(tx, row, answer, ())


def write_rejection(
    tx: JournalWrite,
    row: ActionRow,
    answer: HostAnswer,
    judged: Sequence[tuple[Condition, ConditionResult]],
) -> None:
    """Write a rejection down; any other answer leaves the action as it is."""
    if answer.kind != action_states.REJECT:
        return
    tx.move(row.action_id, ActionState.ACCEPTED, ActionState.REJECTED)
    body: dict[str, Any] = {
        "code": answer.code,
        "message": answer.message,
        "pre": results_body(judged),
    }
    if answer.code in _GIVEN_BACK:
        body["is_given_back"] = True
    tx.append("rejected", row.action_id, body)


def write_actuated(
    tx: JournalWrite, row: ActionRow, report: ActionReport, context: Mapping[str, Any] | None = None
) -> None:
    """Write down that the device has answered, and in which context; what follows only reads."""
    body = report_body(report)
    tx.move(row.action_id, ActionState.STARTED, ActionState.ACTUATED, report=body)
    tx.append("actuated", row.action_id, {**body, "context": dict(context or {})})


def write_end(
    tx: JournalWrite,
    row: ActionRow,
    report: ActionReport,
    post: Sequence[tuple[Condition, ConditionResult]],
    answered: Mapping[str, Any] | None = None,
) -> Conclusion:
    """Settle an action and write its end: row, resources and events together.

    What it has set is unknown again where its device was halted meanwhile.

    Args:
        tx: The write.
        row: The action.
        report: What its device answered.
        post: Its post-conditions with their verdicts.
        answered: The context of the answer, where `write_actuated` has not written it: nothing is
            read between answer and end.

    Raises:
        JournalError: With `answered`, that the action is not started any more.
    """
    is_one_of_two = paired_actions.partner_of(row.do) is not None
    report = paired_actions.as_one_of_two(report) if is_one_of_two else report
    told = report_body(report)
    if answered is not None:
        tx.append("actuated", row.action_id, {**told, "context": dict(answered)})
    operation = row.operation
    known = snapshot(tx, operations.touched_ids(operation))
    only_reads = isinstance(operation, operations.Read)
    concluded = action_states.conclude(
        report,
        post,
        only_reads=only_reads,
        is_undone_by_halt=isinstance(operation, operations.Update)
        and halted_setpoints.is_undone_by_halt(row.do.action),
    )
    conclusion, change = _settle(operation, known, concluded)
    revs = apply_change(tx, change, row.action_id)
    body = change_body(change, revs, conclusion.outcome, conclusion.verification)
    body |= {
        "code": conclusion.code,
        "message": conclusion.message,
        "post": results_body(post),
        "report": told,
    }
    is_undone = conclusion.state is ActionState.COMPLETE and halted_setpoints.was_halted(tx, row)
    if is_undone:
        body[halted_setpoints.IS_HALTED] = True
    current = ActionState.STARTED if answered is not None else tx.state_of(row.action_id) or row.st
    tx.move(row.action_id, current, conclusion.state)
    tx.append(conclusion.state.value, row.action_id, body)
    if conclusion.state is ActionState.COMPLETE:
        vanished_setpoints.note_complete(tx, row)
    else:
        paired_actions.halt_other(tx, row.do)
    if is_undone:
        halted_setpoints.write_halt(tx, row, halted_setpoints.WITH_ACTION)
    return conclusion


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundDevice:
    """How a device was found whose action nobody has seen end."""

    is_halted: bool
    """It was told to halt, or may have been. What else it was set to is gone with that."""

    is_owed: bool = False
    """The word was not delivered for certain: it is to be halted before it acts again."""

    text: str
    """Whether it stands, or may still move, and why."""

    readings: Mapping[str, Any] = field(default_factory=dict)
    """What it told after it was halted."""


def recover(tx: JournalWrite, row: ActionRow, found: FoundDevice | None = None) -> bool:
    """Put in doubt what was started and never answered; True: it is in doubt from here on.

    Nothing is sent: nobody can tell whether the device acted.

    Args:
        tx: The write.
        row: The action.
        found: How its device was found before this; None: nobody looked.
    """
    current = tx.state_of(row.action_id)
    if current is None or action_states.recover(current) is not ActionState.IN_DOUBT:
        return False
    if current is ActionState.IN_DOUBT:
        return False
    report = ActionReport(
        ok=False,
        effect=Effect.UNKNOWN,
        code="edge.interrupted",
        message="the host stopped between start and answer" + (f"; {found.text}" if found else ""),
        evidence=dict(found.readings) if found else {},
    )
    if found is not None and found.is_halted:
        halted_setpoints.write_halt(tx, row, halted_setpoints.INTERRUPTED)
    if found is not None and found.is_owed:
        halted_setpoints.owe_halt(tx, row.device_id, halted_setpoints.INTERRUPTED, row.action_id)
    write_end(tx, row, report, [])
    return True


def _settle(
    operation: operations.Operation, known: settlement.Snapshot, conclusion: Conclusion
) -> tuple[Conclusion, Change]:
    """Settle; a report that contradicts the record means that nobody knows."""
    try:
        return conclusion, settlement.settle(operation, known, conclusion.outcome)
    except LabError as error:
        unknown = Outcome(kind=OutcomeKind.UNKNOWN)
        doubtful = Conclusion(
            state=ActionState.IN_DOUBT,
            outcome=unknown,
            verification=Verification.ASSUMED,
            code=error.code,
            message=error.message,
        )
        return doubtful, settlement.settle(operation, known, unknown)
