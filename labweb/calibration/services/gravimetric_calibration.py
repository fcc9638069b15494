"""A pump is weighed: which pump and balance, the workflow, and the result of its run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple
from uuid import UUID

import msgspec

from labweb.calibration.models import Calibration
from labweb.calibration.selectors import CompletedJob, completed_jobs
from labweb.common.clock import now
from labweb.domain.calibration.calibration_order import VolumeOrder, check_order, levels_ul
from labweb.domain.calibration.calibration_result import CalibrationOutcome, Criteria, judge
from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.calibration.gravimetric_volume import Weighing, check_evaporation, points_of
from labweb.domain.enrollment.admitted_device import AdmittedDevice as DeviceData
from labweb.domain.errors import Finding, PreconditionError
from labweb.domain.workflows.calibration_workflows import (
    gravimetric_workflow,
    weighing_ids,
    weighing_order,
)
from labweb.domain.workflows.passes.devices.calibration_correction import largest_stroke_nl
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.liquids.pump_choice import pump_node
from labweb.domain.workflows.passes.role_requirements import acting_node, plays, setting
from labweb.enrollment.selectors import Device


class _Pump(NamedTuple):
    """A pump with its balance, as the lab has them."""

    pump_id: UUID
    balance_id: UUID
    capacity_ul: float
    stroke_ul: float
    resolution_ul: float


def drawn(
    view: PlannerView, device: Device, order: VolumeOrder
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Draw the workflow that weighs a pump; return it with what its judge needs to know.

    Raises:
        PreconditionError: The lab cannot do it; `findings` list every reason.
    """
    bench = _bench_of(view, device, order)
    volumes = weighing_order(levels_ul(bench.stroke_ul), order.repeats)
    document = gravimetric_workflow(
        f"Calibrate {device.name} by weighing",
        pump=bench.pump_id,
        balance=bench.balance_id,
        source=order.source_id,
        target=order.target_id,
        volumes_ul=volumes,
    )
    facts = {
        "levels": volumes,
        "full_scale": bench.capacity_ul,
        "resolution": bench.resolution_ul,
    }
    return document, facts


def judged(row: Calibration) -> tuple[list[Finding], CalibrationOutcome | None]:
    """Judge the weighings of a run that has ended; the points are put into the row."""
    order = msgspec.convert(
        {key: row.order[key] for key in VolumeOrder.__struct_fields__}, VolumeOrder
    )
    weighings, missing = _weighings(row)
    if missing:
        return missing, None
    points = points_of(weighings, order.around, order.reference.expanded)
    row.points = [
        {**msgspec.to_builtins(point), "weighing": msgspec.to_builtins(weighing)}
        for point, weighing in zip(points, weighings, strict=True)
    ]
    criteria = Criteria(
        tolerance=order.tolerance,
        least_levels=3,
        least_repeats=3,
        full_scale=row.order["full_scale"],
        resolution=row.order["resolution"],
    )
    others = check_evaporation(weighings, order.tolerance)
    found = judge(CalibrationQuantity.VOLUME, points, criteria, others=others)
    return (list(found.findings), found) if isinstance(found, CalibrationOutcome) else (found, None)


def _bench_of(view: PlannerView, row: Device, order: VolumeOrder) -> _Pump:
    """Return the pump and the balance of an order.

    Raises:
        PreconditionError: They cannot do it; `findings` list every reason.
    """
    device = view.find_device(row.id)
    balance = view.find_device(order.balance_id)
    found = check_order(order, today=now().date())
    pump_id = None if device is None else pump_node(view, device)
    if device is None or pump_id is None:
        text = f"{row.name} is no admitted pump with one syringe: its volume cannot be calibrated"
        found.append(Finding("calibration.not_a_pump", text, "device_id"))
    state = None if pump_id is None else view.state(pump_id)
    if pump_id is not None and (state is None or not state.capacity_nl):
        text = f"nobody stated how much the syringe of {row.name} holds: set capacity_ul"
        found.append(Finding("crutd.unknown_capacity", text, "device_id"))
    balance_id = None if balance is None else _pan(view, balance, order.target_id, found)
    if balance is None:
        text = "no admitted device is that balance"
        found.append(Finding("calibration.no_balance", text, "balance_id"))
    is_known = device is not None and state is not None and state.capacity_nl
    if found or not is_known or pump_id is None or balance_id is None:
        first = found[0]
        raise PreconditionError(first.message, code=first.code, findings=found)
    capacity_nl = state.capacity_nl if state is not None and state.capacity_nl else 0
    steps = setting(device, "steps_full_count") if device is not None else None
    stroke_nl = largest_stroke_nl(device, capacity_nl) if device is not None else capacity_nl
    return _Pump(
        pump_id=pump_id,
        balance_id=balance_id,
        capacity_ul=capacity_nl / 1000,
        stroke_ul=stroke_nl / 1000,
        resolution_ul=capacity_nl / 1000 / steps if steps else 0.0,
    )


def _pan(view: PlannerView, balance: DeviceData, target: UUID, found: list[Finding]) -> UUID | None:
    """Return the balance's resource; note when it does not weigh, or not that vessel."""
    if not plays(balance, "balance"):
        text = f"{balance.name} is no balance"
        found.append(Finding("calibration.no_balance", text, "balance_id"))
        return None
    above = {one.id for one in view.tree.ancestors(target)} if target in view.tree.by_id else set()
    if not above & set(balance.nodes.values()):
        text = f"the vessel does not stand on {balance.name}: put it there, and record that"
        found.append(Finding("calibration.not_on_balance", text, "target_id"))
    return acting_node(balance, "weigh")


def _weighings(row: Calibration) -> tuple[list[Weighing], list[Finding]]:
    """Read what a run weighed and pumped out of its own jobs."""
    jobs: dict[str, list[CompletedJob]] = {}
    for job in completed_jobs(row):
        jobs.setdefault(job.step_id, []).append(job)
    begun: float | None = None
    made, missing = [], []
    for place, level in enumerate(row.order["levels"]):
        before, move, after = (jobs.get(step, []) for step in weighing_ids(place))
        masses = [_mass_mg(found) for found in (before, after)]
        sent = [one.args["volume_ul"] for one in move if one.action == "dispense"]
        if None in masses or not sent:
            text = f"weighing {place + 1} of {level:g} µL has no reading"
            missing.append(Finding("calibration.no_reading", text, str(row.run_id)))
            continue
        times = [found[-1].ended_at.timestamp() for found in (before, after) if found[-1].ended_at]
        begun = times[0] if begun is None else begun
        made.append(
            Weighing(
                asked_ul=level,
                indicated_ul=sum(sent),
                before_mg=float(masses[0] or 0),
                after_mg=float(masses[1] or 0),
                before_s=round(times[0] - begun, 3),
                after_s=round(times[-1] - begun, 3),
            )
        )
    return made, missing


def _mass_mg(found: list[CompletedJob]) -> float | None:
    report: Mapping[str, Any] = found[-1].evidence.get("report", {}) if found else {}
    mass = (report.get("evidence") or {}).get("mass_mg")
    return float(mass) if isinstance(mass, int | float) and not isinstance(mass, bool) else None
