"""Reads for holds: what the runs of a lab may need, hold and wait for."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any
from uuid import UUID

import msgspec

from labweb.common.database.prepared_queries import Question, together
from labweb.crutd.selectors.run_holds import RunHold as RunHold
from labweb.crutd.selectors.run_holds import holds_of as holds_of
from labweb.domain.crutd import operations
from labweb.domain.runs.exclusive_use.run_claims import (
    Claims,
    DeviceWay,
    JobProgress,
    Use,
    claims_of,
    needs_of,
    stand_of,
)
from labweb.domain.runs.exclusive_use.run_holds import HoldAsk, HoldScene, Party, UseMode
from labweb.domain.runs.states.job_states import JobState, RunState
from labweb.domain.workflows.plan import CapableDevice, Plan, PlannedJob
from labweb.resources import selectors as resource_selectors
from labweb.runs.models import Job, Run
from labweb.runs.selectors.run_needs import LIVE

_RUNS = """
SELECT id, number, state, claims::text, waits::text, pause_reasons <> '[]'::jsonb
FROM runs_run WHERE lab_id = %s AND state = ANY(%s) ORDER BY number
"""

_JOBS = """
SELECT j.run_id, j.index, j.state, j.passed_by, j.halted_by
FROM runs_job j JOIN runs_run r ON r.id = j.run_id
WHERE r.lab_id = %s AND r.state = ANY(%s) ORDER BY j.run_id, j.index
"""

_HELD = """
SELECT h.run_id, h.resource_id, h.mode FROM crutd_runhold h JOIN runs_run r ON r.id = h.run_id
WHERE r.lab_id = %s AND h.released_at IS NULL
"""

_WAITING = {RunState.QUEUED.value, RunState.RUNNING.value}


def claims_in(value: Mapping[str, Any] | None) -> Claims:
    """Return what a run declared at its start."""
    return Claims() if value is None else msgspec.convert(value, Claims)


def claims_of_plan(plan: Plan, kinds: Mapping[UUID, str]) -> Claims:
    """Return all that any path of a plan may use.

    Args:
        plan: The plan.
        kinds: Kind of each resource of the lab.
    """
    steps = [step.step_id for step in plan.steps]
    return claims_of([_use_of(job) for job in plan.jobs], kinds, steps)


def _use_of(job: PlannedJob) -> Use:
    ways = tuple(_way(one, one.locks) for one in job.ways())
    return Use(index=job.index, step_id=job.step_id, action=job.action, ways=ways)


def _way(one: PlannedJob | CapableDevice, locks: Iterable[UUID]) -> DeviceWay:
    return DeviceWay(
        device_id=one.device_id, operation=one.operation, args=one.args, locks=tuple(locks)
    )


def claims_of_jobs(run: Run) -> Claims:
    """Return the same of the jobs that a run has by now, without those that others replaced."""
    rows = Job.objects.filter(run=run).exclude(passed_by="change").order_by("index")
    uses = [_use_of_row(job) for job in rows]
    ids = {
        node
        for use in uses
        for way in use.ways
        for node in (*way.locks, *operations.touched_ids(way.operation))
    }
    kinds = dict(resource_selectors.rows(ids).values_list("id", "kind"))
    steps = [step["step_id"] for step in run.plan["steps"]]
    return claims_of(uses, kinds, steps)


def _use_of_row(job: Job) -> Use:
    chosen = msgspec.convert(job.choices, tuple[CapableDevice, ...])
    ways = tuple(_way(one, one.locks) for one in chosen) or (
        DeviceWay(
            device_id=job.device_id,
            operation=operations.from_json(job.operation),
            args=job.args,
            locks=tuple(UUID(node) for node in job.locks),
        ),
    )
    return Use(index=job.index, step_id=job.step_id, action=job.action, ways=ways)


def stands_of(run_id: UUID) -> list[JobProgress]:
    """Return where the jobs of a run stand."""
    rows = Job.objects.filter(run_id=run_id).order_by("index")
    columns = rows.values_list("index", "state", "passed_by", "halted_by")
    return [_stand(*row) for row in columns]


def _stand(index: int, state: str, passed_by: str, halted_by: str) -> JobProgress:
    return stand_of(index, JobState(state), passed_by, halted_by)


def held_by(run_id: UUID) -> dict[UUID, UseMode]:
    """Return how a run holds each thing that it holds now."""
    rows = RunHold.objects.filter(run_id=run_id, released_at=None)
    return {node: UseMode(mode) for node, mode in rows.values_list("resource_id", "mode")}


def scene_of(lab_id: UUID, asked: Collection[UUID]) -> tuple[HoldScene, dict[UUID, int]]:
    """Return what decides about a grant, and the numbers of the runs; two exchanges.

    Args:
        lab_id: The lab.
        asked: What somebody asks for.
    """
    found: list[list[tuple[Any, ...]]] = together(
        Question(_RUNS, [lab_id, LIVE], tuple),
        Question(_JOBS, [lab_id, LIVE], tuple),
        Question(_HELD, [lab_id], tuple),
    )
    runs, jobs, holds = found
    stands: dict[UUID, list[JobProgress]] = {}
    queued: set[UUID] = set()
    for run_id, index, state, passed_by, halted_by in jobs:
        stands.setdefault(run_id, []).append(_stand(index, state, passed_by, halted_by))
        if state == JobState.QUEUED.value:
            queued.add(run_id)
    held: dict[UUID, dict[UUID, UseMode]] = {}
    for run_id, node, mode in holds:
        held.setdefault(run_id, {})[node] = UseMode(mode)
    parties: list[Party] = []
    waiting: list[HoldAsk] = []
    for run_id, number, state, claims, waits, is_paused in runs:
        declared = Claims() if claims is None else msgspec.json.decode(claims, type=Claims)
        parties.append(_party(run_id, declared, stands.get(run_id, []), held.get(run_id, {})))
        if waits is not None and not is_paused and state in _WAITING and run_id in queued:
            waiting.append(ask_in(run_id, number, msgspec.json.decode(waits)))
    scene = HoldScene(parties=parties, waiting=waiting)
    above = resource_selectors.ancestors(_named(scene).union(asked))
    numbers = {row[0]: row[1] for row in runs}
    return HoldScene(parties=parties, waiting=waiting, above=above), numbers


def _party(
    run_id: UUID, claims: Claims, stands: list[JobProgress], held: dict[UUID, UseMode]
) -> Party:
    needs, choices = needs_of(claims, stands, held)
    has_begun = bool(held) or any(one.has_acted for one in stands)
    return Party(id=run_id, has_begun=has_begun, held=held, needs=needs, choices=choices)


def ask_in(run_id: UUID, number: int, waits: Mapping[str, Any]) -> HoldAsk:
    """Return what a run waits for, from its row."""
    wanted = {UUID(node): UseMode(mode) for node, mode in waits["wanted"].items()}
    return HoldAsk(run_id=run_id, turn=(waits["since"], number), wanted=wanted)


def _named(scene: HoldScene) -> set[UUID]:
    named: set[UUID] = set()
    for party in scene.parties:
        named.update(party.held, party.needs, *(way for ways in party.choices for way in ways))
    return named.union(*(one.wanted for one in scene.waiting))
