"""How much each vessel holds right now: the record, and between events the pumps' plungers."""

from __future__ import annotations

from collections.abc import Mapping

from twin.state import Snapshot, TwinDevice, TwinJob, TwinResource

AT_WORK = frozenset({"dispatched", "accepted", "running", "completing"})
"""States of a job during which its device may be moving."""

PLUNGER_STATUS = "volume_ul"


def jobs_by_device(snapshot: Snapshot) -> dict[str, TwinJob]:
    """Return the job of each device; one in doubt before one at work."""
    found: dict[str, TwinJob] = {}
    for job in snapshot.jobs.values():
        if job.device_id not in found or job.state == "in_doubt":
            found[job.device_id] = job
    return found


def plungers_ul(snapshot: Snapshot) -> dict[str, float]:
    """Return what each pump's plunger position amounts to, by the pump's resource."""
    found: dict[str, float] = {}
    for device in snapshot.devices.values():
        pump = _pump_of(device, snapshot.resources)
        sample = snapshot.telemetry.get(device.id, {}).get(PLUNGER_STATUS)
        if pump is not None and sample is not None and isinstance(sample[1], int | float):
            found[pump.id] = float(sample[1])
    return found


def volumes_ul(snapshot: Snapshot) -> dict[str, float]:
    """Return the volume to draw in each vessel.

    Between two events the record stands still while the plunger moves. What the plunger
    has moved since is shown as taken from the source and given to the target of the job
    that moves it, never more than the job may move.
    """
    volumes = {row.id: row.total_ul for row in snapshot.resources.values()}
    plungers = plungers_ul(snapshot)
    for device_id, job in jobs_by_device(snapshot).items():
        pump = _pump_of(snapshot.devices.get(device_id), snapshot.resources)
        if pump is None or pump.id not in plungers or job.state not in AT_WORK:
            continue
        drawn = plungers[pump.id] - volumes[pump.id]
        moved = drawn if job.target_id == pump.id else -drawn
        moved = min(max(moved, 0.0), job.amount_nl / 1000.0)
        if job.source_id in volumes and job.target_id in volumes:
            volumes[job.source_id] = max(volumes[job.source_id] - moved, 0.0)
            volumes[job.target_id] += moved
    return volumes


def _pump_of(
    device: TwinDevice | None, resources: Mapping[str, TwinResource]
) -> TwinResource | None:
    if device is None:
        return None
    rows = (resources.get(node) for node in device.nodes.values())
    return next((row for row in rows if row is not None and row.kind == "syringe_pump"), None)
