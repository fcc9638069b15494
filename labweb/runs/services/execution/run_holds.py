"""Give runs what they keep for themselves, in the order of asking, and take it back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db.transaction import atomic, on_commit

from labweb.common import feed
from labweb.common.clock import now
from labweb.common.database.prepared_queries import Question
from labweb.common.dispatcher_wakeup import wake_dispatcher
from labweb.crutd import services as crutd_services
from labweb.domain.crutd import operations
from labweb.domain.errors import LockedError
from labweb.domain.runs.exclusive_use import run_claims as rules
from labweb.domain.runs.exclusive_use.run_claims import Claims, RunClaim
from labweb.domain.runs.exclusive_use.run_holds import HoldAsk, HoldRefusal, Party, UseMode, Why
from labweb.domain.runs.states.job_states import RunState
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Job, Run
from labweb.runs.selectors import run_holds as reads

_NOBODY = dict.fromkeys(("why", "run_id", "number", "resource_id", "resource", "until_step"))
_ENDED = {RunState.COMPLETE.value, RunState.ABORTED.value}


@dataclass(frozen=True, slots=True)
class Granted:
    """What a run takes before jobs of it are sent."""

    modes: dict[UUID, tuple[UseMode, int]]
    """How it holds each, and until which of its steps."""

    writing: Sequence[Question[Any]]
    """Writes it, in the block that sends the jobs."""

    wanted: Mapping[UUID, UseMode] = field(default_factory=dict)
    """What it keeps of this between its steps."""

    def in_line(self, error: LockedError) -> LockedError:
        """Return the error of a lock that is not free, so that the run keeps its place in the line.

        Its locks are free in a moment; what it keeps is not to go to one that asks after it.
        """
        wanted = {str(node): mode.value for node, mode in self.wanted.items()}
        context = {**_NOBODY, **error.context, "wanted": wanted}
        return LockedError(error.message, code=error.code, findings=error.findings, context=context)


def ask(run: Run, jobs: Sequence[Job]) -> Granted:
    """Ask for all that a run has to hold before jobs of it are sent.

    Args:
        run: The run, locked.
        jobs: What is to be sent, each on the device that was chosen for it.

    Raises:
        LockedError: `run.held`: it waits; `context` is what `note_waiting` keeps. Nothing was
            written.
    """
    claims = _declared(run)
    stands, held = reads.stands_of(run.pk), reads.held_by(run.pk)
    asked = rules.asked_by(claims, stands, [job.index for job in jobs], _used(jobs), held)
    if not asked:
        return Granted({}, [])
    wanted = rules.modes_in(asked)
    scene, numbers = reads.scene_of(run.lab_id, wanted)
    needs, choices = rules.needs_of(claims, stands, held)
    has_begun = bool(held) or any(one.has_acted for one in stands)
    asker = Party(id=run.pk, has_begun=has_begun, held=held, needs=needs, choices=choices)
    since = now().timestamp() if run.waits is None else run.waits["since"]
    whole = HoldAsk(run_id=run.pk, turn=(since, run.number), wanted=wanted)
    refused, kept = rules.decide(asker, whole, asked, scene)
    if refused is not None:
        raise _waiting(refused, kept, numbers[refused.run_id])
    modes = _taken(asked, held, claims, stands)
    keeper = crutd_services.Keeper(run_id=run.pk, number=run.number, holder_id=run.created_by_id)
    if run.waits is not None:
        run.waits = None
        run.save(update_fields=["waits"])
    wanted = rules.modes_in(claim for claim in asked if claim.is_kept)
    return Granted(modes, [crutd_services.taking(keeper, modes)], wanted)


def _declared(run: Run) -> Claims:
    """Return the claims of a run; of one that was started before there were any, made now."""
    if run.claims is None:
        declare(run)
    return reads.claims_in(run.claims)


def declare(run: Run) -> None:
    """Write down all that any path of a run may use, by the jobs that it has now."""
    run.claims = msgspec.to_builtins(reads.claims_of_jobs(run), str_keys=True)
    run.save(update_fields=["claims"])


def _used(jobs: Iterable[Job]) -> set[UUID]:
    found: set[UUID] = set()
    for job in jobs:
        found.update(UUID(node) for node in job.locks)
        found.update(operations.touched_ids(operations.from_json(job.operation)))
    return found


def _taken(
    asked: Sequence[RunClaim],
    held: dict[UUID, UseMode],
    claims: Claims,
    stands: Sequence[rules.JobProgress],
) -> dict[UUID, tuple[UseMode, int]]:
    """Return how each thing is held from here on: what was held in another way is held alone."""
    until: dict[UUID, int] = {}
    for claim in rules.open_claims(claims, stands):
        if claim.resource_id in held or claim in asked:
            until[claim.resource_id] = max(until.get(claim.resource_id, 0), claim.until_step)
    modes = rules.modes_in(asked)
    return {
        node: (mode if held.get(node) in {None, mode} else UseMode.ALONE, until[node])
        for node, mode in modes.items()
    }


def _waiting(refused: HoldRefusal, ask: HoldAsk, number: int) -> LockedError:
    name = resource_selectors.names([refused.resource_id])[refused.resource_id]
    hold = reads.holds_of([refused.run_id]).filter(resource_id=refused.resource_id).first()
    until = None if hold is None else hold.until_step
    match refused.why:
        case Why.TURN:
            why = f"which asked for {name} before"
        case Why.UNSAFE:
            why = f"which holds {name}: with what this one asks for, neither could end"
        case _ if until is None:
            why = f"which uses {name} or something in it"
        case _:
            why = f"which holds {name} until its step {until}"
    return LockedError(
        f"waits for run #{number}, {why}",
        code="run.held",
        context={
            "why": refused.why.value,
            "run_id": str(refused.run_id),
            "number": number,
            "resource_id": str(refused.resource_id),
            "resource": name,
            "until_step": until,
            "wanted": {str(node): mode.value for node, mode in ask.wanted.items()},
        },
    )


def _told(run_id: UUID) -> list[tuple[str, dict[str, Any]]]:
    data = {"run_id": str(run_id), "job_id": None}
    return [(f"run:{run_id}", data), ("runs", data)]


@atomic
def note_waiting(run_id: UUID, error: LockedError) -> None:
    """Keep for whom and for what a run waits, and since when; what is no such wait is passed over.

    The time is that of the first time that it was refused: it is its place in the line.
    """
    if not error.context.get("wanted"):
        return
    run = selectors.run_for_update(run_id)
    since = now().timestamp() if run.waits is None else run.waits["since"]
    waits = {**error.context, "since": since, "text": error.message}
    if run.waits == waits or run.state in _ENDED:
        return
    run.waits = waits
    run.save(update_fields=["waits"])
    on_commit(partial(feed.publish_all, _told(run_id)))


def release(run: Run) -> None:
    """Let go what a run cannot need any more; all of it once it has ended.

    Effect:
        None on matter. What others wait for is given to them in the next turn.
    """
    held = reads.held_by(run.pk)
    if not held:
        return
    stands = reads.stands_of(run.pk)
    gone = rules.released(_declared(run), stands, held, has_ended=run.state in _ENDED)
    if gone and crutd_services.release_holds(run.pk, gone):
        wake_dispatcher()
