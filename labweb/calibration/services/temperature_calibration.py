"""A heater is held at set points beside a reference: the workflow, and the result of its run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from uuid import UUID

import msgspec

from labweb.calibration.models import Calibration
from labweb.calibration.selectors import CompletedJob, completed_jobs
from labweb.common.clock import now
from labweb.domain.calibration.calibration_order import TemperatureOrder, check_temperature_order
from labweb.domain.calibration.calibration_result import CalibrationOutcome, Criteria, judge
from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.calibration.thermometer_comparison import (
    LEAST_SET_POINTS,
    RESOLUTION_C,
    Comparison,
    points_of,
)
from labweb.domain.enrollment.admitted_device import AdmittedDevice as DeviceData
from labweb.domain.errors import Finding, PreconditionError
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.workflows.calibration_workflows import comparison_ids, thermal_workflow
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.role_requirements import HOLD_TOLERANCE_C, acting_node, plays
from labweb.enrollment.selectors import Device

_HEATS = ("heater", "thermostat")


def drawn(
    view: PlannerView, row: Device, order: TemperatureOrder
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Draw the workflow that compares a heater's probe; return it with what its judge needs.

    Raises:
        PreconditionError: The lab cannot do it; `findings` list every reason.
    """
    found = check_temperature_order(order, today=now().date())
    device, thermometer = view.find_device(row.id), view.find_device(order.thermometer_id)
    heater_id = None
    if device is None or not any(plays(device, role) for role in _HEATS):
        text = f"{row.name} is no admitted heater or thermostat that tells its temperature"
        found.append(Finding("calibration.not_a_heater", text, "device_id"))
    else:
        heater_id = acting_node(device, "hold")
        found += _check_vessel(view, device, order.vessel_id)
    thermometer_id = _thermometer(view, row, thermometer, order.vessel_id, found)
    if found or heater_id is None or thermometer_id is None:
        first = found[0]
        raise PreconditionError(first.message, code=first.code, findings=found)
    set_points_c = sorted(order.set_points_c)
    document = thermal_workflow(
        f"Calibrate the temperature of {row.name}",
        heater=heater_id,
        thermometer=thermometer_id,
        vessel=order.vessel_id,
        set_points_c=set_points_c,
        settle_s=order.settle_s,
        repeats=order.repeats,
        tolerance_c=HOLD_TOLERANCE_C,
        stir_speed_rpm=order.stir_speed_rpm,
    )
    return document, {"levels": set_points_c}


def judged(row: Calibration) -> tuple[list[Finding], CalibrationOutcome | None]:
    """Judge the comparisons of a run that has ended; the points are put into the row."""
    order = msgspec.convert(
        {key: row.order[key] for key in TemperatureOrder.__struct_fields__}, TemperatureOrder
    )
    made, missing = _comparisons(row, order.repeats)
    if missing:
        return missing, None
    points = points_of(made, order.reference.expanded)
    row.points = [
        {**msgspec.to_builtins(point), "comparison": msgspec.to_builtins(one)}
        for point, one in zip(points, made, strict=True)
    ]
    criteria = Criteria(
        tolerance=order.tolerance,
        least_levels=LEAST_SET_POINTS,
        least_repeats=2,
        resolution=RESOLUTION_C,
    )
    found = judge(CalibrationQuantity.TEMPERATURE, points, criteria)
    return (list(found.findings), found) if isinstance(found, CalibrationOutcome) else (found, None)


def _check_vessel(view: PlannerView, device: DeviceData, vessel_id: UUID) -> list[Finding]:
    """List why a vessel cannot show what the device heats; nothing else may heat it."""
    state = view.state(vessel_id)
    if vessel_id not in view.vessels_on(device) or state is None:
        text = f"the vessel does not stand on {device.name}: put it there, and record that"
        return [Finding("calibration.not_on_heater", text, "vessel_id")]
    found = []
    others = [
        one.name
        for one in view.devices_by_key
        if one.id != device.id
        and any(plays(one, role) for role in _HEATS)
        and vessel_id in view.vessels_on(one)
    ]
    if others:
        text = f"the vessel is heated by {', '.join(others)}, too: part them"
        found.append(Finding("calibration.not_on_heater", text, "vessel_id"))
    if not total_nl(state.contents):
        text = "the vessel is empty by the record: both thermometers have to stand in liquid"
        found.append(Finding("calibration.vessel_empty", text, "vessel_id"))
    return found


def _thermometer(
    view: PlannerView, row: Device, device: DeviceData | None, vessel_id: UUID, found: list[Finding]
) -> UUID | None:
    """Return the resource that measures; note when it is no thermometer, or not in the vessel."""
    if device is None or device.id == row.id or not plays(device, "thermometer"):
        text = "no other admitted device that measures a temperature is that thermometer"
        found.append(Finding("calibration.not_a_thermometer", text, "thermometer_id"))
        return None
    if vessel_id not in view.vessels_on(device):
        text = f"{device.name} does not dip into that vessel: connect them in the lab"
        found.append(Finding("calibration.not_in_vessel", text, "vessel_id"))
    return acting_node(device, "measure")


def _comparisons(row: Calibration, repeats: int) -> tuple[list[Comparison], list[Finding]]:
    """Read what both thermometers told out of the jobs of a run."""
    done = completed_jobs(row, ("hold", "measure"))
    jobs = {job.step_id: job for job in done}
    begun: float | None = None
    made, missing = [], []
    for place, set_point_c in enumerate(row.order["levels"]):
        for reading in range(repeats):
            held, read = (jobs.get(step_id) for step_id in comparison_ids(place, reading))
            indicated_c, reference_c = _told_c(held), _told_c(read)
            at = None if read is None else read.ended_at
            if held is None or indicated_c is None or reference_c is None or at is None:
                text = f"reading {reading + 1} at {set_point_c:g} °C is missing"
                missing.append(Finding("calibration.no_reading", text, str(row.run_id)))
                continue
            begun = at.timestamp() if begun is None else begun
            made.append(
                Comparison(
                    set_point_c=set_point_c,
                    sent_c=held.args["temperature_c"],
                    indicated_c=indicated_c,
                    reference_c=reference_c,
                    at_s=round(at.timestamp() - begun, 3),
                )
            )
    return made, missing


def _told_c(job: CompletedJob | None) -> float | None:
    report: Mapping[str, Any] = {} if job is None else job.evidence.get("report", {})
    value = (report.get("evidence") or {}).get("temperature_c")
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
