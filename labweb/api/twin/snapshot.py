"""The lab as the twin sees it, and what has changed in it since."""

from __future__ import annotations

import time
from typing import Any

from labweb.crutd import selectors as crutd_selectors
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.runs.states.job_states import AT_EDGE, JobState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.fleet.api.devices import device_rows
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Connection, Lab, Resource
from labweb.runs import selectors as run_selectors
from labweb.runs.selectors import Job
from labweb.telemetry import selectors as telemetry_selectors

Body = dict[str, Any]

TABLES = ("resources", "connections", "devices", "jobs")
_CONFIG: dict[str, type | tuple[type, ...]] = {
    "capacity_ul": (int, float),
    "ports_count": int,
    "common_port": str,
    "shape": str,
}
"""What shapes a body. A foreign file may use the same words for other things: those stay out."""

_LIVE_JOBS = frozenset(state.value for state in (*AT_EDGE, JobState.IN_DOUBT))


def snapshot() -> Body:
    """Return everything the twin draws; a fixed number of queries.

    Raises:
        NotFoundError: No lab was imported yet.
    """
    lab = resource_selectors.the_lab()
    devices = enrollment_selectors.present_devices(lab)
    jobs = run_selectors.jobs_at_devices(row.id for row in devices)
    latest = telemetry_selectors.latest(row.id for row in devices)
    return {
        "lab": {
            "key": lab.key,
            "name": lab.name,
            "mode": lab.mode,
            "is_stopped": lab.is_stopped,
        },
        "resources": _resources(lab),
        "connections": _connections(lab),
        "devices": {
            str(row.id): {
                "id": str(row.id),
                "name": row.name,
                "nodes": dict(device.nodes),
                "state": row.state,
                "link": row.link,
            }
            for device, row in zip(devices, device_rows(devices), strict=True)
        },
        "jobs": {str(job.id): _job(job) for job in jobs.values() if job.state in _LIVE_JOBS},
        "telemetry": {str(device_id): statuses for device_id, statuses in latest.items()},
        "at_s": time.time(),
    }


def changes(before: Body, after: Body) -> list[tuple[str, Any]]:
    """List what the twin has to be told to get from one snapshot to the next.

    Telemetry is left out: samples travel as they come in.
    """
    found: list[tuple[str, Any]] = []
    if before["lab"] != after["lab"]:
        found.append(("lab", after["lab"]))
    for table in TABLES:
        old, new = before[table], after[table]
        changed = {key: row for key, row in new.items() if old.get(key) != row}
        gone = sorted(old.keys() - new.keys())
        if changed or gone:
            found.append((table, {"changed": changed, "gone": gone}))
    return found


def _resources(lab: Lab) -> Body:
    rows = list(resource_selectors.resources_of(lab))
    held = crutd_selectors.contents(row.id for row in rows)
    lots = resource_selectors.lots_of(lab).order_by("key").values_list("id", flat=True)
    numbers = {str(lot_id): str(number) for number, lot_id in enumerate(lots)}
    return {
        str(row.id): _resource(
            row, {numbers.get(lot, "0"): amount for lot, amount in held.get(row.id, {}).items()}
        )
        for row in rows
    }


def _resource(row: Resource, contents: dict[str, int]) -> Body:
    known = {
        name: row.config[name]
        for name, kind in _CONFIG.items()
        if isinstance(row.config.get(name), kind) and not isinstance(row.config[name], bool)
    }
    return {
        **known,
        "id": str(row.id),
        "key": row.key,
        "parent_id": None if row.parent_id is None else str(row.parent_id),
        "name": row.name,
        "kind": row.kind,
        "pose": row.pose,
        "size_mm": row.size_mm,
        "contents_nl": contents,
        "is_quarantined": row.quarantined_by is not None,
        "is_archived": row.is_archived,
    }


def _connections(lab: Lab) -> Body:
    shown = [Medium.LIQUID.value, Medium.MECHANICAL.value]
    rows = resource_selectors.connections_of(lab).filter(medium__in=shown)
    return {str(row.id): _connection(row) for row in rows}


def _connection(row: Connection) -> Body:
    return {
        "id": str(row.id),
        "key": row.key,
        "medium": row.medium,
        "source": {"resource_id": str(row.source_id), "port": row.source_port},
        "target": {"resource_id": str(row.target_id), "port": row.target_port},
    }


def _job(job: Job) -> Body:
    operation = job.operation
    row = {
        "id": str(job.id),
        "device_id": str(job.device_id),
        "state": job.state,
        "sentence": job.sentence,
    }
    if operation.get("op") == "transfer_liquid":
        row |= {
            "source_id": operation["source_id"],
            "target_id": operation["target_id"],
            "amount_nl": operation["amount_nl"],
        }
    return row
