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

from labweb.domain.messages import BatchPart
from labweb.domain.runs.edge import FINAL, HOLD, REJECT, ActionState, Answer
from labweb.domain.runs.job import JobState
from labweb.domain.runs.journal import JournalWrite
from labweb.domain.runs.locks import Lock
from labweb.domain.runs.scheduler import JobView

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
        is_waiting = job.state is JobState.QUEUED and job.host_id in online_hosts
        if not is_waiting or job.is_carry:
            continue
        members = found.setdefault(job.host_id, [])
        known = done | {one.index for one in members}
        if len(members) < MOST_MEMBERS and known.issuperset(job.after):
            members.append(job)
    return [tuple(members) for members in found.values() if members]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """What decides whether it is the turn of a member of a batch."""

    part: BatchPart
    before: tuple[ActionState | None, ...]
    """Where the actions before it stand; None: this host does not have it."""

    offline_s: float | None
    """For how long the server has been away; None: it is there."""


def decide_turn(turn: Turn) -> Answer | None:
    """Decide whether a member waits or is given back; None: it is its turn.

    An action before it that is in doubt is waited for: a person may say that it happened.
    """
    for state in turn.before:
        if state is None or (state in FINAL and state is not ActionState.COMPLETE):
            text = "what comes before it in the batch did not complete"
            return Answer(REJECT, "edge.predecessor", text)
    if any(state is not ActionState.COMPLETE for state in turn.before):
        return Answer(HOLD, "edge.waits", "what comes before it in the batch is not complete")
    if turn.offline_s is None:
        return None
    part = turn.part
    may_go_on = part.on_disconnect == OnDisconnect.CONTINUE
    if may_go_on and turn.offline_s <= part.max_offline_s:
        return None
    return Answer(HOLD, "edge.offline", f"the server has been away for {turn.offline_s:.0f} s")


class States(Protocol):
    """A journal that can be asked where an action stands."""

    def state_of(self, action_id: UUID) -> ActionState | None:
        """Return where an action stands, or None."""


def turn_of(tx: States, part: BatchPart | None, offline_s: float | None) -> Turn | None:
    """Read from the journal what decides about a member; None: it stands alone."""
    if part is None:
        return None
    before = tuple(tx.state_of(action_id) for action_id in part.after)
    return Turn(part=part, before=before, offline_s=offline_s)


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
