"""A batch: all that one host does of a run, which goes there whole and needs no further word.

A workflow that declares `execution` is sent in batches. One that declares nothing goes job
by job: a host whose server is away finishes what it was given, and nothing follows.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol
from uuid import UUID

from labweb.domain.messages.commands import BatchPart, Do, HostBatch, decode_command
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.dispatch.job_scheduler import JobView, pair_of
from labweb.domain.runs.exclusive_use.action_locks import Lock
from labweb.domain.runs.host_journal import paired_actions
from labweb.domain.runs.host_journal.action_states import (
    FINAL,
    HOLD,
    REJECT,
    ActionState,
    HostAnswer,
)
from labweb.domain.runs.host_journal.journal_rows import JournalWrite
from labweb.domain.runs.states.job_states import JobState
from labweb.domain.workflows.plan import Execution

MOST_MEMBERS = 60
"""A longer part of a run goes in several batches, one after the other."""


class OnDisconnect(StrEnum):
    """What a host does with a batch while its server is away."""

    CONTINUE = "continue"
    """Go on to the end of the batch, for `max_offline_s` at most."""

    FINISH_CURRENT_THEN_HOLD = "finish_current_then_hold"
    """What acts runs to its end; nothing begins before the session is resumed."""

    STOP_SAFE = "stop_safe"
    """What acts is halted, and what waits is given back."""


# --- the server's side --------------------------------------------------------------


def find_batches(
    jobs: Sequence[JobView], online_hosts: Collection[UUID]
) -> list[tuple[JobView, ...]]:
    """Return, for each host that is online, the jobs of a run that may go there now.

    A job is one of the batch when all before it is complete or in the batch too, so that
    the host never has to ask. One that carries a thing is none: other hosts have a say.

    Args:
        jobs: All jobs of one run.
        online_hosts: Hosts that may get work.
    """
    done = {job.index for job in jobs if job.is_satisfied}
    found: dict[UUID, list[JobView]] = {}
    for job in sorted(jobs, key=lambda one: one.index):
        together = (job,) if job.meets is None else pair_of(job, jobs)
        if together is None or not all(_may_be_sent(one, online_hosts) for one in together):
            continue
        members = found.setdefault(job.host_id, [])
        known = done | {one.index for one in members}
        is_room = len(members) + len(together) <= MOST_MEMBERS
        if is_room and all(known.issuperset(one.after) for one in together):
            members += together
    return [tuple(members) for members in found.values() if members]


def _may_be_sent(job: JobView, online_hosts: Collection[UUID]) -> bool:
    is_waiting = job.state is JobState.QUEUED and job.host_id in online_hosts
    return is_waiting and not job.is_carry and not job.is_asking


ALONE = Execution(on_disconnect=OnDisconnect.CONTINUE, max_offline_s=3600.0)
"""How two jobs that meet go, where the workflow declares nothing: as a job that goes alone, which
a host may start for so long after it has accepted it."""


def heirs(held: Sequence[UUID], claims: Mapping[UUID, Collection[UUID]]) -> dict[UUID, UUID | None]:
    """Say who holds each lock of a batch after one of its members has ended.

    A host works a batch off without asking, so what a later member needs is never free in
    between.

    Args:
        held: Resources that the ended member has locked.
        claims: Resources that each open member needs, by member.

    Returns:
        The member that holds it from here on, by resource; None: it is free.
    """
    return {
        resource: next((one for one, needed in claims.items() if resource in needed), None)
        for resource in held
    }


def shares(claims: Sequence[Collection[Lock]], wanted: Sequence[Lock]) -> list[list[Lock]]:
    """Share the locks of a batch out: each to the first member that needs its resource."""
    found: list[list[Lock]] = [[] for _ in claims]
    for lock in wanted:
        for share, claim in zip(found, claims, strict=True):
            if any(one.resource_id == lock.resource_id for one in claim):
                share.append(lock)
                break
    return found


# --- the host's side ----------------------------------------------------------------


def read_members(command: HostBatch) -> list[tuple[Signed, Do]]:
    """Read the members of a batch.

    Raises:
        msgspec.MsgspecError: One of them is no command.
        ValueError: One is for another host, session or batch, or comes out of order.
    """
    found: list[tuple[Signed, Do]] = []
    seen: set[UUID] = set()
    for text in command.members:
        do = decode_command(text.body)
        if not isinstance(do, Do) or do.batch is None or do.resources:
            raise ValueError("a member of a batch is an action of it, without resources")
        same = (do.host_id, do.epoch, do.batch.batch_id)
        if same != (command.host_id, command.epoch, command.batch_id):
            raise ValueError("a member belongs to another host, session or batch")
        if not seen.issuperset(do.batch.after):
            raise ValueError("a member waits for one that is not before it")
        if found and do.dseq <= found[-1][1].dseq:
            raise ValueError("members come in the order of their dispatch")
        seen.add(do.action_id)
        found.append((text, do))
    if not found or found[0][1].dseq != command.dseq:
        raise ValueError("a batch begins with its first member")
    paired_actions.check_pairs([do for _, do in found])
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchTurn:
    """What decides whether it is the turn of a member of a batch."""

    part: BatchPart
    before: tuple[ActionState | None, ...]
    """Where the actions before it stand; None: this host does not have it."""

    offline_s: float | None
    """For how long the server has been away; None: it is there."""


def decide_turn(turn: BatchTurn) -> HostAnswer | None:
    """Decide whether a member waits or is given back; None: it is its turn.

    An action before it that is in doubt is waited for: a person may say that it happened.
    """
    for state in turn.before:
        if state is None or (state in FINAL and state is not ActionState.COMPLETE):
            text = "what comes before it in the batch did not complete"
            return HostAnswer(REJECT, "edge.predecessor", text)
    if any(state is not ActionState.COMPLETE for state in turn.before):
        return HostAnswer(HOLD, "edge.waits", "what comes before it in the batch is not complete")
    if turn.offline_s is None:
        return None
    part = turn.part
    may_go_on = part.on_disconnect == OnDisconnect.CONTINUE
    if may_go_on and turn.offline_s <= part.max_offline_s:
        return None
    return HostAnswer(HOLD, "edge.offline", f"the server has been away for {turn.offline_s:.0f} s")


class States(Protocol):
    """A journal that can be asked where an action stands."""

    def state_of(self, action_id: UUID) -> ActionState | None:
        """Return where an action stands, or None."""


def turn_of(tx: States, part: BatchPart | None, offline_s: float | None) -> BatchTurn | None:
    """Read from the journal what decides about a member; None: it stands alone."""
    if part is None:
        return None
    before = tuple(tx.state_of(action_id) for action_id in part.after)
    return BatchTurn(part=part, before=before, offline_s=offline_s)


def stop_safely(tx: JournalWrite) -> list[UUID]:
    """Give back what waits and halt what acts of every batch that wants it so.

    Returns:
        The actions that act and are to be halted.

    Effect:
        On the record; the lines halt their devices as for a cancel.
    """
    halted = []
    for row in tx.open_rows():
        part = row.do.batch
        if part is None or part.on_disconnect != OnDisconnect.STOP_SAFE:
            continue
        if row.st is ActionState.ACCEPTED:
            tx.move(row.action_id, ActionState.ACCEPTED, ActionState.STOPPED)
            body = {
                "code": "edge.link_lost",
                "message": "the server went away before it started",
                "is_given_back": True,
            }
            tx.append("stopped", row.action_id, body)
        elif row.st is ActionState.STARTED:
            tx.want_cancel(row.action_id)
            halted.append(row.action_id)
    return halted
