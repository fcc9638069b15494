"""A probe is read in buffers: the workflow that brings them, and the result of its run."""

from __future__ import annotations

from typing import Any

import msgspec

from labweb.calibration.models import Calibration
from labweb.calibration.selectors import completed_jobs
from labweb.common.clock import now
from labweb.domain.calibration.calibration_order import PhOrder, check_ph_order
from labweb.domain.calibration.calibration_result import CalibrationOutcome, Criteria, judge
from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.calibration.ph_buffers import (
    RESOLUTION_PH,
    BufferReading,
    check_filling,
    points_of,
)
from labweb.domain.errors import Finding, PreconditionError, StateError
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.workflows.calibration_workflows import buffer_workflow, reading_id
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.liquids.pump_choice import pump_node
from labweb.domain.workflows.passes.role_requirements import acting_node, plays
from labweb.enrollment.selectors import Device


def drawn(view: PlannerView, row: Device, order: PhOrder) -> tuple[dict[str, Any], dict[str, Any]]:
    """Draw the workflow that reads a probe in buffers; return it with nothing besides.

    Raises:
        PreconditionError: The lab cannot do it; `findings` list every reason.
    """
    found = check_ph_order(order, today=now().date())
    device, pump = view.find_device(row.id), view.find_device(order.pump_id)
    probe_id = acting_node(device, "measure") if device and plays(device, "ph") else None
    pump_id = None if pump is None else pump_node(view, pump)
    if device is None or probe_id is None:
        text = f"{row.name} is no admitted probe that measures pH"
        found.append(Finding("calibration.not_a_probe", text, "device_id"))
    elif order.vessel_id not in view.vessels_on(device):
        text = f"{row.name} does not dip into that vessel: connect them in the lab"
        found.append(Finding("calibration.not_in_vessel", text, "vessel_id"))
    if pump_id is None:
        text = "no admitted device is that pump"
        found.append(Finding("calibration.not_a_pump", text, "pump_id"))
    state = view.state(order.vessel_id)
    dead_ul = 0.0 if state is None else state.dead_volume_nl / 1000
    if state is None:
        found.append(Finding("calibration.not_in_vessel", "there is no such vessel", "vessel_id"))
    else:
        held_nl = total_nl(state.contents)
        found += check_filling(holds_nl=held_nl, dead_ul=dead_ul, volume_ul=order.volume_ul)
    if found or probe_id is None or pump_id is None:
        first = found[0]
        raise PreconditionError(first.message, code=first.code, findings=found)
    document = buffer_workflow(
        f"Calibrate {row.name} in buffers",
        pump=pump_id,
        probe=probe_id,
        vessel=order.vessel_id,
        waste=order.waste_id,
        sources=[one.source_id for one in order.buffers],
        volume_ul=order.volume_ul,
        dead_ul=dead_ul,
        settle_s=order.settle_s,
        repeats=order.repeats,
    )
    return document, {}


def judged(row: Calibration) -> tuple[list[Finding], CalibrationOutcome | None]:
    """Judge the readings of a run that has ended; the points are put into the row."""
    order = msgspec.convert({key: row.order[key] for key in PhOrder.__struct_fields__}, PhOrder)
    readings, missing = _readings(row, order)
    if missing:
        return missing, None
    try:
        points = points_of(readings)
    except StateError as error:
        return [Finding(error.code, error.message, str(row.run_id))], None
    row.points = [
        {**msgspec.to_builtins(point), "reading": msgspec.to_builtins(reading)}
        for point, reading in zip(points, readings, strict=True)
    ]
    criteria = Criteria(
        tolerance=order.tolerance, least_levels=2, least_repeats=2, resolution=RESOLUTION_PH
    )
    found = judge(CalibrationQuantity.PH, points, criteria)
    return (list(found.findings), found) if isinstance(found, CalibrationOutcome) else (found, None)


def _readings(row: Calibration, order: PhOrder) -> tuple[list[BufferReading], list[Finding]]:
    done = completed_jobs(row, ("measure",))
    jobs = {job.step_id: job for job in done}
    begun: float | None = None
    made, missing = [], []
    for place, buffer in enumerate(order.buffers):
        for repeat in range(order.repeats):
            job = jobs.get(reading_id(place, repeat))
            told = {} if job is None else job.evidence.get("report", {}).get("evidence") or {}
            value_ph, temperature_c = told.get("value_ph"), told.get("temperature_c")
            if value_ph is None or temperature_c is None or job is None or job.ended_at is None:
                text = f"reading {repeat + 1} in the {buffer.standard} buffer is missing"
                missing.append(Finding("calibration.no_reading", text, str(row.run_id)))
                continue
            at_s = job.ended_at.timestamp()
            begun = at_s if begun is None else begun
            made.append(
                BufferReading(
                    standard=buffer.standard,
                    value_ph=float(value_ph),
                    temperature_c=float(temperature_c),
                    expanded=buffer.reference.expanded,
                    at_s=round(at_s - begun, 3),
                )
            )
    return made, missing
