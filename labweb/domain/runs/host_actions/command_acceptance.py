"""How a host takes a command into its journal: decide, write, and say which line to wake."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.crutd import operations, settlement
from labweb.domain.crutd.pre_and_postconditions import Condition, Verification
from labweb.domain.crutd.settlement import OutcomeKind
from labweb.domain.errors import LabError
from labweb.domain.messages.commands import (
    Cancel,
    Command,
    Do,
    Halt,
    HostBatch,
    ReceiveCommand,
    Release,
    Reset,
    Resolve,
    ResourceView,
)
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.protocol_version import PROTOCOL_VERSION
from labweb.domain.runs.after_failure.doubt_by_readings import against_the_record
from labweb.domain.runs.exclusive_use import resource_custody
from labweb.domain.runs.halts import halted_setpoints, vanished_setpoints
from labweb.domain.runs.host_actions.host_batch import read_members
from labweb.domain.runs.host_journal import action_states, paired_actions
from labweb.domain.runs.host_journal.action_states import ActionState, HostAnswer
from labweb.domain.runs.host_journal.event_bodies import change_body
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import ActionRow, JournalWrite
from labweb.domain.runs.host_journal.known_resources import (
    adopt,
    apply_change,
    snapshot,
    stale_resource,
)


@dataclass(frozen=True, slots=True)
class Receipt:
    """What became of a command."""

    answer: HostAnswer
    line: str | None = None
    """Line that has something to do."""

    lines: tuple[str, ...] = ()
    """Lines of a batch that have something to do."""


def take_command(
    tx: JournalWrite,
    signed: Signed,
    command: Command,
    *,
    at: HostMoment,
    line_of: Callable[[UUID], str | None],
) -> Receipt:
    """Take one command, whose signature holds, into the journal; safe to repeat.

    Args:
        tx: The write that keeps it.
        signed: The command as it came.
        command: What it says.
        at: When it came.
        line_of: Line of a device; None: this host does not serve it.

    Effect:
        On the record only.
    """
    if isinstance(command, HostBatch):
        return _take_batch(tx, signed, command, at=at, line_of=line_of)
    known = tx.action(command.action_id) if isinstance(command, Do) else None
    is_cancelled = isinstance(command, Do) and tx.is_tombstoned(command.action_id)
    answer = action_states.decide_accept(
        tx.host_state(at.boot_id),
        host_id=command.host_id,
        epoch=command.epoch,
        dseq=_dispatch_of(command, tx.host_state(at.boot_id).floor),
        known=None if known is None else known.st,
        is_tombstoned=is_cancelled,
    )
    if answer.kind == action_states.ACCEPT and command.v != PROTOCOL_VERSION:
        answer = HostAnswer(
            action_states.REFUSE, "envelope.version", f"version {command.v} is not spoken here"
        )
    if answer.kind == action_states.REFUSE:
        return _refuse(tx, command, signed, answer)
    if answer.kind == action_states.DUPLICATE:
        is_waiting = known is not None and known.st is ActionState.ACCEPTED
        return Receipt(answer, known.line if known is not None and is_waiting else None)
    if answer.kind == action_states.DROP:
        return Receipt(answer)
    if isinstance(command, Do):
        return _take_do(tx, signed, command, at=at, line=line_of(command.device_id))
    return _take_word(tx, signed, command)


def _dispatch_of(command: Command, floor: int) -> int:
    """Return by which number a command counts: a halt that is due is never too old."""
    return max(command.dseq, floor) if isinstance(command, Halt) else command.dseq


def _take_word(
    tx: JournalWrite,
    signed: Signed,
    command: Cancel | Resolve | Reset | Halt | Release | ReceiveCommand,
) -> Receipt:
    """Take a command that makes nothing act."""
    match command:
        case Cancel():
            return _take_cancel(tx, command)
        case Resolve():
            return _take_resolve(tx, signed, command)
        case Reset():
            return _take_reset(tx, command)
        case Halt():
            is_new = halted_setpoints.take_halt(tx, command)
            return Receipt(HostAnswer(action_states.ACCEPT if is_new else action_states.DUPLICATE))
        case Release() | ReceiveCommand():
            return _take_custody(tx, command)


def _refuse(tx: JournalWrite, command: Command, signed: Signed, answer: HostAnswer) -> Receipt:
    digest = hashlib.sha256(signed.body.encode()).hexdigest()
    action_id = command.action_id if isinstance(command, Do | Cancel | Resolve) else None
    subject = f"{answer.code}:{digest}"
    name = str(command.__struct_config__.tag)
    record_refusal(tx, subject, action_id, answer, digest, command=name)
    return Receipt(answer)


def record_refusal(
    tx: JournalWrite,
    subject: str,
    action_id: UUID | None,
    answer: HostAnswer,
    digest: str,
    *,
    command: str = "",
) -> None:
    """Tell of a refusal once: a message that comes again says nothing new.

    Args:
        tx: The write.
        subject: What makes two refusals the same.
        action_id: Action the command speaks of; None where its text cannot be trusted.
        answer: Why.
        digest: SHA-256 of the text.
        command: `do`, `cancel`, `resolve`, `reset`, `halt` or `batch`; empty where it is not known.
    """
    if tx.is_first_refusal(subject):
        body = {
            "command": command,
            "code": answer.code,
            "message": answer.message,
            "body_sha256": digest,
        }
        tx.append("refused", action_id, body)


def _take_batch(
    tx: JournalWrite,
    signed: Signed,
    command: HostBatch,
    *,
    at: HostMoment,
    line_of: Callable[[UUID], str | None],
) -> Receipt:
    """Take a batch whole: when one member cannot be kept, none is.

    A member that was cancelled on its way is left out; what follows from it never starts.
    """
    try:
        members = read_members(command)
    except (msgspec.MsgspecError, ValueError) as exc:
        return _refuse(
            tx, command, signed, HostAnswer(action_states.REFUSE, "envelope.malformed", str(exc))
        )
    known = [tx.state_of(do.action_id) for _, do in members]
    answer = action_states.decide_accept(
        tx.host_state(at.boot_id),
        host_id=command.host_id,
        epoch=command.epoch,
        dseq=command.dseq,
        known=next((state for state in known if state is not None), None),
        is_tombstoned=False,
    )
    if answer.kind == action_states.ACCEPT and command.v != PROTOCOL_VERSION:
        answer = HostAnswer(
            action_states.REFUSE, "envelope.version", f"version {command.v} is not spoken here"
        )
    if answer.kind == action_states.REFUSE:
        return _refuse(tx, command, signed, answer)
    lines = {do.action_id: line_of(do.device_id) for _, do in members}
    if answer.kind != action_states.ACCEPT:
        is_known = answer.kind == action_states.DUPLICATE
        return Receipt(answer, lines=_named(lines.values()) if is_known else ())
    left = [(text, do) for text, do in members if not tx.is_tombstoned(do.action_id)]
    problem = _problem_of_batch(tx, command, [do for _, do in left], lines)
    if problem is None:
        adopt(tx, command.resources)
    for text, do in left:
        _take_do(tx, text, do, at=at, line=lines[do.action_id], problem=problem)
    return Receipt(answer, lines=() if problem is not None else _named(lines.values()))


def _named(lines: Iterable[str | None]) -> tuple[str, ...]:
    return tuple(sorted({line for line in lines if line is not None}))


def _problem_of_batch(
    tx: JournalWrite, command: HostBatch, members: Sequence[Do], lines: Mapping[UUID, str | None]
) -> HostAnswer | None:
    """Say why a batch can never start here; None: it may be kept."""
    stale = stale_resource(tx, command.resources)
    if stale is not None:
        return _stale(stale)
    for do in members:
        problem = _problem(tx, do, lines[do.action_id])
        if problem is not None:
            return problem
    return None


def _take_do(
    tx: JournalWrite,
    signed: Signed,
    do: Do,
    *,
    at: HostMoment,
    line: str | None,
    problem: HostAnswer | None = None,
) -> Receipt:
    problem = problem or _problem(tx, do, line)
    state = ActionState.REJECTED if problem else ActionState.ACCEPTED
    tx.insert_action(
        ActionRow(
            action_id=do.action_id,
            dseq=do.dseq,
            epoch=do.epoch,
            line=line or "",
            device_id=do.device_id,
            body=signed.body,
            key_id=signed.key_id,
            signature=signed.signature,
            st=state,
            accepted_mono_s=at.mono_s,
            accepted_boot_id=at.boot_id,
            accepted_wall_s=at.wall_s,
            is_cancel_wanted=False,
            prestate=None,
            report=None,
        )
    )
    body: dict[str, Any] = {"epoch": do.epoch, "dseq": do.dseq}
    if problem is not None:
        tx.append(
            "rejected", do.action_id, {**body, "code": problem.code, "message": problem.message}
        )
        return Receipt(HostAnswer(action_states.REJECT, problem.code, problem.message))
    adopt(tx, do.resources)
    tx.append("accepted", do.action_id, {**body, "line": line})
    return Receipt(HostAnswer(action_states.ACCEPT), line)


def _problem(tx: JournalWrite, do: Do, line: str | None) -> HostAnswer | None:
    """Say why a command can never start here; None: it may be kept."""
    try:
        operations.from_json(do.operation)
        msgspec.convert([*do.pre, *do.post], list[Condition])
    except msgspec.MsgspecError as exc:
        return HostAnswer(
            action_states.REJECT, "edge.malformed", f"the action cannot be read: {exc}"
        )
    if not (math.isfinite(do.timeout_s) and do.timeout_s > 0 and do.ttl_s >= 0):
        return HostAnswer(action_states.REJECT, "edge.malformed", "timeout_s must be positive")
    if line is None:
        return HostAnswer(
            action_states.REJECT, "edge.unknown_device", f"no device {do.device_id} here"
        )
    stale = stale_resource(tx, do.resources)
    return None if stale is None else _stale(stale)


def _stale(view: ResourceView) -> HostAnswer:
    message = f"{view.name} is at revision {view.rev} here; the server knew an older one"
    return HostAnswer(action_states.REJECT, "edge.stale", message)


# --- custody, cancel, resolve, reset ---


def _take_custody(tx: JournalWrite, command: Release | ReceiveCommand) -> Receipt:
    """Let a vessel go, unless an action of this host uses it, or take one over."""
    if isinstance(command, ReceiveCommand):
        is_new = resource_custody.take_receive(tx, command)
    else:
        in_use = {node for row in tx.open_rows() for node in operations.touched_ids(row.operation)}
        is_new = resource_custody.take_release(tx, command, in_use=in_use)
    return Receipt(HostAnswer(action_states.ACCEPT if is_new else action_states.DUPLICATE))


def _take_cancel(tx: JournalWrite, cancel: Cancel) -> Receipt:
    row = tx.action(cancel.action_id)
    body = {
        "code": "edge.cancelled",
        "message": "cancelled before it started",
        "issued_by": cancel.issued_by,
        "is_given_back": cancel.is_recall,
    }
    if row is None:
        if tx.add_tombstone(cancel.action_id, cancel.dseq):
            tx.append("stopped", cancel.action_id, {**body, "is_tombstone": True})
        return Receipt(HostAnswer(action_states.ACCEPT))
    if row.st is ActionState.ACCEPTED:
        tx.move(row.action_id, ActionState.ACCEPTED, ActionState.STOPPED)
        tx.append("stopped", row.action_id, {**body, "is_tombstone": False})
        return Receipt(HostAnswer(action_states.ACCEPT))
    if row.st in {ActionState.STARTED, ActionState.ACTUATED}:
        if cancel.is_recall:
            return Receipt(HostAnswer(action_states.DUPLICATE))
        tx.want_cancel(row.action_id)
        paired_actions.halt_other(tx, row.do)
        return Receipt(HostAnswer(action_states.ACCEPT))
    return Receipt(HostAnswer(action_states.DUPLICATE))


def _take_resolve(tx: JournalWrite, signed: Signed, resolve: Resolve) -> Receipt:
    row = tx.action(resolve.action_id)
    if row is None or row.st is not ActionState.IN_DOUBT:
        return Receipt(HostAnswer(action_states.DUPLICATE))
    found = action_states.resolve(resolve.answer, moved_nl=resolve.moved_nl)
    if found is None:
        text = f"{resolve.answer!r} with {resolve.moved_nl} nL answers nothing"
        return _refuse(
            tx, resolve, signed, HostAnswer(action_states.REFUSE, "envelope.bad_answer", text)
        )
    state, outcome = found
    operation = row.operation
    try:
        change = settlement.settle(
            operation, snapshot(tx, operations.touched_ids(operation)), outcome
        )
    except LabError as exc:
        return _refuse(
            tx, resolve, signed, HostAnswer(action_states.REFUSE, exc.code, against_the_record(exc))
        )
    if outcome.kind is OutcomeKind.UNKNOWN:
        change = replace(change, data=settlement.given_up(operation))
    revs = apply_change(tx, change, row.action_id)
    body = change_body(change, revs, outcome, Verification.ASSUMED)
    body |= {
        "state": state.value,
        "answer": resolve.answer,
        "note": resolve.note,
        "issued_by": resolve.issued_by,
        **({"despite_reading": resolve.despite_reading} if resolve.despite_reading else {}),
    }
    is_undone = state is ActionState.COMPLETE and halted_setpoints.was_halted(tx, row)
    if is_undone:  # what happened is over again
        body[halted_setpoints.IS_HALTED] = True
    tx.move(row.action_id, ActionState.IN_DOUBT, state)
    tx.append("resolved", row.action_id, body)
    if state is ActionState.COMPLETE:
        vanished_setpoints.note_complete(tx, row)
    if is_undone:
        halted_setpoints.write_halt(tx, row, halted_setpoints.WITH_ACTION)
    return Receipt(HostAnswer(action_states.ACCEPT), row.line)


def _take_reset(tx: JournalWrite, reset: Reset) -> Receipt:
    """Release the stop that the reset names; every other latch stays closed.

    One that releases nothing is answered too, so that the server rings no more.
    """
    is_released = tx.meta().get("stop_id") == str(reset.stop_id)
    subject = f"reset:{reset.stop_id}"
    if not is_released and not tx.is_first_refusal(subject):
        return Receipt(HostAnswer(action_states.DUPLICATE))
    if is_released:
        tx.set_meta("stop_id", None)
    body = {
        "stop_id": str(reset.stop_id),
        "is_released": is_released,
        "reason": reset.reason,
        "issued_by": reset.issued_by,
    }
    tx.append("stop_reset", None, body)
    return Receipt(HostAnswer(action_states.ACCEPT))
