"""Claims: all that any path of a run may use, read from its plan before it begins.

vessel of the run        ├──────────────────────────┤   from its beginning to its last use
what it carries          ├──────────────────────────┤   and the single places for it
heater that stays on          ├──────────┤              from *on* to *off*, or to the end
syringe with liquid in it        ├────┤                 until it is empty
pump, valve, balance, …       ├┤   ├┤  ├┤               step by step
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from uuid import UUID

import msgspec

from labweb.domain.crutd import operations as ops
from labweb.domain.runs.after_failure.recovery_choices import is_taken_away
from labweb.domain.runs.exclusive_use import run_holds
from labweb.domain.runs.exclusive_use.run_holds import (
    CARRIERS,
    HoldAsk,
    HoldRefusal,
    HoldScene,
    Party,
    UseMode,
    keeps_matter,
    merged,
    modes_of,
    place_mode,
)
from labweb.domain.runs.halts.halted_setpoints import (
    Done,
    is_halt_certain,
    still_standing,
)
from labweb.domain.runs.states.job_states import UNSTARTED, JobState


class RunClaim(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that a run uses without a break, from one job to another."""

    resource_id: UUID
    mode: UseMode
    jobs: tuple[int, ...]
    """While one of these has not ended well, the run may still need it."""

    until_step: int
    """Number of the step after which the run lets it go, from 1."""

    is_from_start: bool = False
    """It is taken before the first job of the run, not before the first of these."""

    is_kept: bool = False
    """It is held between steps; else within one step alone."""

    is_choice: bool = False
    """Used only on some of the devices that may do these jobs."""


class ChoiceOfJob(msgspec.Struct, frozen=True, kw_only=True):
    """What a job takes on each of the devices that may do it, beside what it takes on all."""

    job: int
    ways: tuple[dict[UUID, UseMode], ...]


class Claims(msgspec.Struct, frozen=True, kw_only=True):
    """What a run declares at its start."""

    claims: tuple[RunClaim, ...] = ()
    choices: tuple[ChoiceOfJob, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceWay:
    """A job as one device would do it."""

    device_id: UUID
    operation: ops.Operation
    args: Mapping[str, object]
    locks: tuple[UUID, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Use:
    """A job of a plan, as far as claims are concerned."""

    index: int
    step_id: str
    action: str
    ways: tuple[DeviceWay, ...]


@dataclass(slots=True)
class _Thing:
    """How the jobs of a run use one resource."""

    mode: UseMode | None = None
    blocks: list[int] = field(default_factory=list)
    is_from_start: bool = False
    is_choice: bool = True


@dataclass(frozen=True, slots=True)
class _Course:
    """The jobs of a plan in blocks: what a step does without a break.

    What a step prepares before the others is a block of its own.
    """

    uses: Sequence[Use]
    kinds: Mapping[UUID, str]
    blocks: list[list[int]]
    """Indices of jobs."""

    block_of: Mapping[int, int]


def _course(uses: Sequence[Use], kinds: Mapping[UUID, str]) -> _Course:
    blocks = [[use.index for use in part] for _, part in groupby(uses, key=lambda u: u.step_id)]
    block_of = {index: number for number, block in enumerate(blocks) for index in block}
    return _Course(uses, kinds, blocks, block_of)


def claims_of(uses: Sequence[Use], kinds: Mapping[UUID, str], steps: Sequence[str]) -> Claims:
    """Return all that any path of a plan may use: each device that may do a job counts.

    A thing is claimed for whole steps, since a step that has begun must not be broken into.

    Args:
        uses: The jobs in plan order.
        kinds: Kind of each resource that they name.
        steps: The steps in the order in which people count them.
    """
    course = _course(uses, kinds)
    things, choices = _things(course)
    step_of = {use.index: steps.index(use.step_id) + 1 for use in uses}
    made: list[RunClaim] = []
    for node, thing in sorted(things.items()):
        for part, is_to_the_end in _parts(node, thing, course):
            jobs = {index for block in part for index in course.blocks[block]}
            if is_to_the_end:
                jobs = {use.index for use in uses if use.index >= min(jobs)}
            made.append(
                RunClaim(
                    resource_id=node,
                    mode=thing.mode or UseMode.ALONE,
                    jobs=tuple(sorted(jobs)),
                    until_step=max(step_of[index] for index in jobs),
                    is_from_start=thing.is_from_start and not thing.is_choice,
                    is_kept=thing.is_from_start or is_to_the_end or len(part) > 1,
                    is_choice=thing.is_choice,
                )
            )
    return Claims(claims=tuple(made), choices=tuple(choices))


def _things(course: _Course) -> tuple[dict[UUID, _Thing], list[ChoiceOfJob]]:
    things: dict[UUID, _Thing] = {}
    choices: list[ChoiceOfJob] = []
    kinds = course.kinds
    for use in course.uses:
        ways = [modes_of(way.operation, way.locks, kinds) for way in use.ways]
        always = set(ways[0]).intersection(*ways[1:])
        block = course.block_of[use.index]
        for way, modes in zip(use.ways, ways, strict=True):
            single = _single_places(way.operation, kinds)
            for node, mode in modes.items():
                if mode is UseMode.WITHIN:
                    continue
                thing = things.setdefault(node, _Thing())
                thing.mode = merged(thing.mode, mode)
                thing.is_choice = thing.is_choice and node not in always
                thing.is_from_start |= keeps_matter(kinds.get(node, "")) or node in single
                if block not in thing.blocks:
                    thing.blocks.append(block)
        if len(ways) > 1:
            beside: list[dict[UUID, UseMode]] = [
                {n: m for n, m in way.items() if n not in always and m is not UseMode.WITHIN}
                for way in ways
            ]
            choices.append(ChoiceOfJob(job=use.index, ways=tuple(beside)))
    return things, choices


def _single_places(operation: ops.Operation, kinds: Mapping[UUID, str]) -> set[UUID]:
    """Return what is carried, and where there is room for it alone."""
    if not isinstance(operation, ops.TransferResource):
        return set()
    places = (operation.from_id, operation.to_id)
    single = {one for one in places if place_mode(kinds.get(one, "")) is UseMode.ALONE}
    return {operation.resource_id, *single}


def _parts(node: UUID, thing: _Thing, course: _Course) -> list[tuple[list[int], bool]]:
    """Split the use of a thing where the run leaves nothing in it, on it or going.

    Returns:
        Blocks of each part, and whether it lasts to the end of the run.
    """
    if thing.is_from_start:
        return [(thing.blocks, False)]
    own = [
        use
        for use in course.uses
        if any(node in ops.touched_ids(way.operation) for way in use.ways)
    ]
    found: list[tuple[list[int], bool]] = []
    part: list[int] = []
    for block in thing.blocks:
        part.append(block)
        done = [use for use in own if use.index <= max(course.blocks[block])]
        if not _is_left(node, done, course.kinds):
            found.append((part, False))
            part = []
    return [*found, (part, True)] if part else found


def _is_left(node: UUID, done: Iterable[Use], kinds: Mapping[UUID, str]) -> bool:
    """Say whether a run has left liquid in a carrier, or something going on a device."""
    balance_nl, acts = 0, dict[UUID, list[Done]]()
    for use in done:
        for way in use.ways:
            operation = way.operation
            if isinstance(operation, ops.TransferLiquid):
                balance_nl += operation.amount_nl * (operation.target_id == node)
                balance_nl -= operation.amount_nl * (operation.source_id == node)
            elif isinstance(operation, ops.Update) and is_halt_certain(use.action):
                one = Done(index=use.index, action=use.action, args=way.args)
                acts.setdefault(way.device_id, []).append(one)
    if kinds.get(node) in CARRIERS and balance_nl > 0:
        return True
    return any(still_standing(actions) for actions in acts.values())


# --- what is left of them -------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class JobProgress:
    """Where a job of the run stands."""

    index: int
    is_unbegun: bool
    """It waits for its turn: nothing of it is done or under way."""

    is_over: bool
    """No path of the run comes back to it."""

    has_acted: bool
    """It was sent and not refused: something of it is done or under way."""


def stand_of(index: int, state: JobState, passed_by: str, halted_by: str) -> JobProgress:
    """Return where a job stands. One that ended undone is not over: a person may retry it."""
    is_done = state is JobState.COMPLETE and not is_taken_away(state, halted_by)
    is_passed = bool(passed_by) and state not in UNSTARTED
    has_acted = state not in UNSTARTED | {JobState.STOPPED, JobState.REJECTED}
    return JobProgress(index, state in UNSTARTED, is_done or is_passed, has_acted)


def open_claims(claims: Claims, jobs: Iterable[JobProgress]) -> list[RunClaim]:
    """Return the claims of which some path of the run may still need the thing."""
    ended = {job.index for job in jobs if job.is_over}
    return [one for one in claims.claims if not ended.issuperset(one.jobs)]


def needs_of(
    claims: Claims, jobs: Sequence[JobProgress], held: Mapping[UUID, UseMode]
) -> tuple[dict[UUID, UseMode], list[tuple[dict[UUID, UseMode], ...]]]:
    """Return what a run may still use: surely, and by each job that several devices may do."""
    surely = dict(held)
    for claim in open_claims(claims, jobs):
        if not claim.is_choice:
            surely[claim.resource_id] = merged(surely.get(claim.resource_id), claim.mode)
    waiting = {job.index for job in jobs if job.is_unbegun}
    return surely, [one.ways for one in claims.choices if one.job in waiting]


def asked_by(
    claims: Claims,
    jobs: Sequence[JobProgress],
    sent: Iterable[int],
    used: Iterable[UUID],
    held: Mapping[UUID, UseMode],
) -> list[RunClaim]:
    """Return what a run has to get, at once, before jobs of it are sent.

    That is what it holds from its start, and all that the steps of these jobs use.

    Args:
        claims: Of the run.
        jobs: All its jobs.
        sent: Those that are to be sent.
        used: What they use on the devices that were chosen for them.
        held: What it holds already.
    """
    indices, names = set(sent), set(used)
    return [
        claim
        for claim in open_claims(claims, jobs)
        if (claim.is_from_start or not indices.isdisjoint(claim.jobs))
        and (not claim.is_choice or claim.resource_id in names)
        and held.get(claim.resource_id) not in {claim.mode, UseMode.ALONE}
    ]


def modes_in(claims: Iterable[RunClaim]) -> dict[UUID, UseMode]:
    """Return how the things of claims are used, each once."""
    found: dict[UUID, UseMode] = {}
    for claim in claims:
        found[claim.resource_id] = merged(found.get(claim.resource_id), claim.mode)
    return found


def released(
    claims: Claims, jobs: Sequence[JobProgress], held: Iterable[UUID], *, has_ended: bool
) -> set[UUID]:
    """Return what a run holds and cannot need any more; when it has ended, all of it.

    What it has taken for a part of its way that is over is let go, also when it comes to use the
    same thing again later; what it holds from its start stays until the last use.
    """
    if has_ended:
        return set(held)
    begun = {job.index for job in jobs if not job.is_unbegun}
    kept = {
        claim.resource_id
        for claim in open_claims(claims, jobs)
        if claim.is_from_start or not begun.isdisjoint(claim.jobs)
    }
    return set(held) - kept


def decide(
    asker: Party, ask: HoldAsk, asked: Iterable[RunClaim], scene: HoldScene
) -> tuple[HoldRefusal | None, HoldAsk]:
    """Decide whether a run gets what it asks for, and say what it waits for when it does not.

    What it needs for one step alone is not kept from others while it waits for what it keeps.
    """
    kept = HoldAsk(
        run_id=ask.run_id,
        turn=ask.turn,
        wanted=modes_in(claim for claim in asked if claim.is_kept),
    )
    found = run_holds.refusal(asker, kept, scene)
    if found is not None:
        return found, kept
    return run_holds.refusal(asker, ask, scene), ask
