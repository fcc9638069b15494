"""What a crate of a run holds, read from the record."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from datetime import datetime
from typing import Any
from uuid import UUID

from django.db.models import QuerySet

from labweb.common.clock import now
from labweb.common.render import iso
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd.selectors import lineage
from labweb.domain.crutd.provenance.graph_from_record import reported
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.records.selectors import activity_facts
from labweb.records.selectors.event_file import clock_of
from labweb.runs.selectors import Attempt, HostEvent, Job, Run
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry.selectors import File

_CHUNK = 10_000


def actions_of(run: Run) -> dict[UUID, UUID]:
    """Return the transaction of each try, by the try's id."""
    rows = Attempt.objects.filter(job__run=run).order_by("dseq")
    return dict(rows.values_list("pk", "transaction_id"))


def devices_of(run: Run) -> list[Device]:
    """Return the devices that the run's jobs are for."""
    ids = Job.objects.filter(run=run).values("device_id")
    return list(enrollment_selectors.devices_of(run.lab).filter(pk__in=ids).order_by("key"))


def window_of(run: Run) -> tuple[datetime, datetime]:
    """Return the time from the start of a run to its end, or till now."""
    return run.started_at or run.created_at, run.ended_at or now()


def events(run: Run) -> Iterator[dict[str, Any]]:
    """Yield the run's events in the order of the chain, with the hashes that bind them."""
    jobs = run.jobs.values_list("id", flat=True)
    rows = crutd_selectors.events_of(run.lab, job_ids=jobs).order_by("seq")
    for row in rows.iterator(chunk_size=_CHUNK):
        yield {
            "seq": row.seq,
            "at": iso(row.at),
            "received_at": iso(row.received_at),
            "uncertainty_s": row.uncertainty_s,
            "operation": row.name,
            "state": row.state,
            "transaction_id": str(row.transaction_id),
            "body": row.body,
            "prev_hash": row.prev_hash,
            "hash": row.hash,
        }


def host_events(run: Run) -> Iterator[dict[str, Any]]:
    """Yield what hosts reported of the run's actions, as it came."""
    rows = HostEvent.objects.filter(action_id__in=actions_of(run)).order_by("id")
    for row in rows.iterator(chunk_size=_CHUNK):
        yield {
            "host_id": str(row.host_id),
            "journal_id": str(row.journal_id),
            "seq": row.seq,
            "hash": row.hash,
            "kind": row.kind,
            "action_id": str(row.action_id),
            "at_s": row.at_s,
            **clock_of(row),
            "received_at": iso(row.received_at),
            "body": row.body,
        }


def ledger(run: Run) -> Iterator[dict[str, Any]]:
    """Yield what the run moved, by lot, each in the unit of the lot."""
    for flow in lineage.flows_of(actions_of(run).values()):
        for lot, amount in flow.lots.items():
            unit = "amount_ug" if lot in flow.in_ug else "amount_nl"
            yield {
                "transaction_id": flow.activity,
                "at": flow.at,
                "lot_id": lot,
                "debit": flow.source,
                "credit": flow.target,
                unit: amount,
            }


def readings(run: Run) -> Iterator[dict[str, Any]]:
    """Yield what devices reported with the run's jobs."""
    jobs = list(Job.objects.filter(run=run).select_related("device").order_by("index"))
    devices = {str(job.device_id): job.device for job in jobs}
    for fact in activity_facts.job_facts(jobs):
        told = reported(fact)
        if told:
            yield {
                "job_id": fact.id,
                "index": fact.index,
                "sentence": fact.sentence,
                "device": devices[fact.device_id].key,
                "driver_digest": fact.driver_digest,
                "at": fact.ended_at or None,
                "verification": fact.verification,
                "reported": told,
            }


def approvals(run: Run) -> list[dict[str, Any]]:
    """Return the decisions about the run, with the names that stand under them."""
    facts = activity_facts.decision_facts(run.lab, [str(run.pk)])
    names = activity_facts.people(fact.actor_id for fact in facts)
    return [
        {
            "printed_name": names.get(fact.actor_id, ""),
            "meaning": fact.meaning,
            "is_approved": fact.is_approved,
            "at": fact.at,
        }
        for fact in facts
    ]


def sample_count(run: Run) -> int:
    """Return how many samples the run's devices gave while it went on."""
    since, until = window_of(run)
    ids = [device.pk for device in devices_of(run)]
    return telemetry_selectors.samples(ids, since.timestamp(), until.timestamp()).count()


def samples(run: Run) -> Iterator[tuple[str, str, float, float | None, str | None]]:
    """Yield (device key, status, seconds, number, other value as JSON) of the run's devices."""
    since, until = window_of(run)
    keys = {device.pk: device.key for device in devices_of(run)}
    rows = telemetry_selectors.samples(keys, since.timestamp(), until.timestamp())
    fields = rows.values_list("device_id", "status", "at", "value")
    for device_id, status, at, value in fields.iterator(chunk_size=_CHUNK):
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        number = float(value) if is_number else None
        yield keys[device_id], status, at, number, None if is_number else json.dumps(value)


def kept_files(run: Run, seen: Collection[UUID] | None) -> QuerySet[File]:
    """Return the instrument files of a run's jobs, and the series made from them."""
    rows = telemetry_selectors.files_of_jobs(run.jobs.values_list("id", flat=True))
    if seen is None:
        return rows
    shown = telemetry_selectors.visible_files(run.lab, seen)
    return rows.filter(pk__in=shown.values("pk"))


def kept_name(row: File) -> str:
    """Return where a kept file lies in a crate: its id keeps names apart and plain."""
    suffix = "".join(c for c in row.name.rpartition(".")[2] if c.isascii() and c.isalnum())
    return f"files/{row.pk}.{suffix[:16] or 'bin'}"


def file_readings(rows: Sequence[File]) -> Iterator[dict[str, Any]]:
    """Yield what was read from files, each with its file and its series by their paths."""
    names = {row.pk: kept_name(row) for row in rows}
    jobs = {row.job_id for row in rows if row.job_id is not None}
    for reading in telemetry_selectors.readings_of_jobs(jobs):
        if reading.file_id in names:
            yield {
                "job_id": str(reading.job_id),
                "resource_id": None if reading.resource_id is None else str(reading.resource_id),
                "device_id": None if reading.device_id is None else str(reading.device_id),
                "file": names[reading.file_id],
                "file_sha256": reading.file.sha256,
                "name": reading.name,
                "quantity": reading.quantity,
                "unit": reading.unit,
                "value": reading.value,
                "text": reading.text,
                "series_file": None
                if reading.series_file_id is None
                else names.get(reading.series_file_id),
                "series": reading.series,
                "measured_at": iso(reading.measured_at),
                "facts": reading.facts,
            }
