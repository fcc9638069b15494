"""Every value that runs measured, each with all that led to it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from labweb.crutd.selectors import lineage
from labweb.crutd.selectors.transaction_snapshot import LabMoment, lots_told, moment_after
from labweb.domain.crutd import operations
from labweb.domain.crutd.provenance.graph_from_record import reported
from labweb.domain.crutd.provenance.ledger_flows import is_nominal
from labweb.domain.crutd.provenance.recorded_facts import JobFact
from labweb.enrollment import selectors as enrollment_selectors
from labweb.records.selectors import activity_facts
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.selectors import Attempt, Job, Run
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry.selectors import Reading

_NO_REACTORS = frozenset({"waste", "syringe_pump", "pipette_channel", "tip"})
"""Kinds that matter passes through, or is given up in."""


@dataclass(frozen=True, slots=True)
class DatasetValue:
    """One reading, or one value that a device reported, with its lineage."""

    lineage: dict[str, Any]
    measured: dict[str, Any]
    series: Reading | None = None
    """The reading whose points follow; None for a single value."""


def values_of(run: Run) -> Iterator[DatasetValue]:
    """Yield every value that the jobs of a run measured, in the order of the jobs.

    Raises:
        ReconcileError: The record of the lab cannot be replayed.
    """
    jobs = list(run.jobs.select_related("device__driver").order_by("index"))
    readings: dict[UUID | None, list[Reading]] = {}
    for reading in telemetry_selectors.readings_of_jobs(job.pk for job in jobs):
        readings.setdefault(reading.job_id, []).append(reading)
    lots = {str(lot.pk): lot for lot in resource_selectors.lots_of(run.lab)}
    for job, fact in zip(jobs, activity_facts.job_facts(jobs), strict=True):
        told = reported(fact)
        found = readings.get(job.pk, [])
        if told or found:
            yield from _values(_Source(run, job, fact, lots), told, found)


@dataclass(frozen=True, slots=True)
class _Source:
    run: Run
    job: Job
    fact: JobFact
    lots: dict[str, Any]


def _values(source: _Source, told: dict[str, Any], found: list[Reading]) -> Iterator[DatasetValue]:
    attempt = selectors.last_attempt(source.job)
    lab = source.run.lab
    moment = None if attempt is None else moment_after(lab, attempt.transaction_id)
    base = _act(source)
    touched = set(operations.touched_ids(operations.from_json(source.job.operation)))
    here = base | _matter(
        source, moment, touched | enrollment_selectors.node_ids(source.job.device)
    )
    for name, value in sorted(told.items()):
        yield DatasetValue(here, _reported(source.job, name, value))
    by_subject: dict[UUID | None, dict[str, Any]] = {None: here}
    for reading in found:
        subject = reading.resource_id
        if subject not in by_subject and subject is not None:
            by_subject[subject] = base | _matter(source, moment, {subject})
        origin = by_subject[subject]
        yield DatasetValue(origin, _measured(reading), None if reading.series is None else reading)


def _act(source: _Source) -> dict[str, Any]:
    """Return who did what, when, by which plan and with which code."""
    run, job, fact = source.run, source.job, source.fact
    return {
        "run_id": str(run.pk),
        "run_number": run.number,
        "workflow": run.version.workflow.name,
        "workflow_digest": run.version.digest,
        "plan_digest": run.plan_digest,
        "started_by": run.created_by.printed_name,
        "job_id": str(job.pk),
        "job_index": job.index,
        "sentence": job.sentence,
        "job_state": job.state,
        "started_at": job.started_at,
        "ended_at": job.ended_at,
        "device": job.device.key,
        "driver": f"{job.device.driver.module}:{job.device.driver.class_name}",
        "driver_digest": fact.driver_digest,
        "verification": fact.verification,
        "conditions": _conditions(run, job),
    }


def _conditions(run: Run, job: Job) -> list[dict[str, Any]]:
    """Return the last sample of each status of the run's devices, up to the end of the job."""
    if job.ended_at is None or run.started_at is None:
        return []
    ids = run.jobs.values_list("device_id", flat=True).distinct()
    keys = dict(
        enrollment_selectors.devices_of(run.lab).filter(pk__in=ids).values_list("pk", "key")
    )
    since, until = run.started_at.timestamp(), job.ended_at.timestamp()
    return [
        {
            "device": keys[device_id],
            "status": status,
            "age_s": until - at,
            "number": None if _other(value) else float(value),
            "other_json": json.dumps(value) if _other(value) else None,
        }
        for device_id, status, at, value in telemetry_selectors.last_samples(keys, since, until)
    ]


def _other(value: object) -> bool:
    return isinstance(value, bool) or not isinstance(value, int | float)


def _matter(source: _Source, moment: LabMoment | None, subjects: set[UUID]) -> dict[str, Any]:
    """Return in which vessels the matter was, of which lots, and through which it had come."""
    if moment is None:
        return {"is_lineage_whole": False, "vessels": [], "lots": [], "came_through": []}
    vessels = moment.vessels_in(subjects)
    nodes, through, is_whole = moment.replay.nodes, set(), True
    for vessel in vessels:
        found, is_all = moment.came_through(vessel)
        through |= set(found)
        is_whole &= is_all
    return {
        "is_lineage_whole": is_whole,
        "vessels": [nodes[vessel].key for vessel in vessels],
        "lots": list(lots_told(moment, vessels, source.lots)),
        "came_through": sorted(nodes[vessel].key for vessel in through if vessel in nodes),
    }


def _reported(job: Job, name: str, value: object) -> dict[str, Any]:
    is_number = not _other(value)
    return {
        "source": "device",
        "quantity": name,
        "unit": "",
        "number": float(str(value)) if is_number else None,
        "text": None if is_number else json.dumps(value, ensure_ascii=False),
        "measured_at": job.ended_at,
        "reading_id": None,
        "file_sha256": None,
    }


def _measured(reading: Reading) -> dict[str, Any]:
    return {
        "source": "file",
        "quantity": reading.quantity,
        "unit": reading.unit,
        "number": reading.value,
        "text": reading.text or None,
        "measured_at": reading.measured_at,
        "reading_id": str(reading.pk),
        "file_sha256": reading.file.sha256,
    }


def end_of(run: Run) -> LabMoment | None:
    """Return the lab after the last event of a run; None when it did nothing."""
    newest = Attempt.objects.filter(job__run=run).order_by("-at", "-dseq").first()
    return None if newest is None else moment_after(run.lab, newest.transaction_id)


def made_in(run: Run, moment: LabMoment) -> list[UUID]:
    """Return the vessels that a run left fuller than it found them, by key; no waste, no pump."""
    gains: dict[str, int] = {}
    acts = Attempt.objects.filter(job__run=run).values_list("transaction_id", flat=True)
    for flow in lineage.flows_of(acts):
        amount = flow.amount_nl + flow.amount_ug
        gains[flow.source] = gains.get(flow.source, 0) - amount
        gains[flow.target] = gains.get(flow.target, 0) + amount
    filled = {name for name, gain in gains.items() if gain > 0 and not is_nominal(name)}
    vessels = [UUID(name) for name in filled]
    nodes = moment.replay.nodes
    kept = [v for v in vessels if v in nodes and nodes[v].kind not in _NO_REACTORS]
    return sorted((v for v in kept if moment.held(v)), key=lambda v: nodes[v].key)
