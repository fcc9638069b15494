"""Provenance as somebody may know it."""

from __future__ import annotations

from collections.abc import Collection
from uuid import UUID

from labweb.accounts.selectors import User
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.provenance.provenance_graph import ProvGraph, redacted
from labweb.domain.crutd.provenance.recorded_facts import MeasurementFact
from labweb.enrollment import selectors as enrollment_selectors
from labweb.records.selectors.provenance import Provenance
from labweb.resources import selectors as resource_selectors
from labweb.runs.selectors import visible_runs


def seen_by(found: Provenance, seen: Collection[UUID]) -> ProvGraph:
    """Return the graph as somebody may know it: what is outside keeps its form, not its words.

    Args:
        found: The whole.
        seen: Resources that they may know of.
    """
    shown = {str(node) for node in seen}
    runs = {str(pk) for pk in visible_runs(found.lab, seen).values_list("pk", flat=True)}
    record = found.record
    jobs = {job.id for job in record.jobs if not found.locks[job.id] <= shown}
    hidden = {f"resource/{fact.id}" for fact in record.resources if fact.id not in shown}
    hidden |= {
        n for n in found.graph.nodes if n.startswith("state/") and n.split("/")[1] not in shown
    }
    hidden |= {f"job/{job}" for job in jobs}
    hidden |= {f"reading/{fact.id}" for fact in record.transactions if fact.job_id in jobs}
    for run in record.runs:
        if run.id not in runs:
            hidden |= {f"run/{run.id}", f"plan/{run.id}", f"version/{run.version_id}"}
    hidden |= {f"decision/{fact.id}" for fact in record.decisions if fact.run_id not in runs}
    devices = enrollment_selectors.visible_devices(found.lab, seen)
    known = {str(device.pk) for device in devices}
    for job in record.jobs:
        for moment, context in job.contexts.items():
            told = {reading["device_id"] for reading in context["environment"]}
            if job.id in jobs or not told <= known:
                hidden.add(f"surroundings/{job.id}/{moment}")
    for measurement in record.measurements:
        if not _is_about(measurement, shown, known):
            hidden |= {f"measurement/{measurement.id}", f"file/{measurement.id}"}
            hidden |= {f"reading/{one.id}" for one in measurement.readings}
            hidden |= {f"file/{one.id}" for one in measurement.made}
    hidden |= {f"device/{fact.id}" for fact in record.devices if fact.id not in known}
    return redacted(found.graph, hidden | _only_with(found.graph, hidden))


def _is_about(fact: MeasurementFact, shown: Collection[str], devices: Collection[str]) -> bool:
    """Tell whether a file may be known: its resource decides, and without one its device."""
    return fact.resource_id in shown if fact.resource_id else fact.device_id in devices


def shown_runs(ids: Collection[str], user: User) -> set[str]:
    """Return which of the runs the user may see."""
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    rows = visible_runs(resource_selectors.the_lab(), seen).filter(pk__in=list(ids))
    return {str(pk) for pk in rows.values_list("pk", flat=True)}


def _only_with(graph: ProvGraph, hidden: Collection[str]) -> set[str]:
    """Return the people and drivers of whom nothing but what is hidden tells."""
    told: dict[str, bool] = {}
    for relation in graph.relations:
        for one, other in (
            (relation.later, relation.third or relation.earlier),
            (relation.earlier, relation.third or relation.later),
        ):
            if one.startswith(("user/", "driver/")):
                told[one] = told.get(one, False) or other not in hidden
    return {name for name, is_told in told.items() if not is_told}
