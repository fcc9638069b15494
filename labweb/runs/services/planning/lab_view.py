"""The lab as it is, in one picture that compiling works on, read in one exchange."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any
from uuid import UUID

import msgspec

from labweb.calibration import selectors as calibration_selectors
from labweb.common.clock import now
from labweb.common.database.prepared_queries import Question, together
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd.selectors.condition_facts import lab_facts
from labweb.domain.crutd.settlement import ResourceState
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device, EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.telemetry import selectors as telemetry_selectors


def lab_view(lab: Lab) -> PlannerView:
    """Return the frozen picture of a lab that compiling works on."""
    return view_of(lab, together(*asking_view(lab.pk)))


def asking_view(lab_id: UUID) -> tuple[Question[Any], ...]:
    """Return what reads a lab for its picture."""
    return (
        resource_selectors.NODES.asking(lab=lab_id),
        enrollment_selectors.TO_PLAN.asking(lab=lab_id),
        resource_selectors.LOTS.asking(lab=lab_id),
        resource_selectors.MATERIALS.asking(lab=lab_id),
        resource_selectors.CONNECTIONS.asking(lab=lab_id),
        calibration_selectors.OF_LAB.asking(lab=lab_id),
        crutd_selectors.asking_amounts(lab_id),
        telemetry_selectors.asking_latest_in(lab_id, "is_initialized"),
    )


def hosts_in(answers: Sequence[list[Any]]) -> dict[UUID, EdgeHost]:
    """Return the host of each device from what `asking_view` was answered."""
    devices: list[Device] = answers[1]
    return {device.id: device.host for device in devices}


def view_of(lab: Lab, answers: Sequence[list[Any]]) -> PlannerView:
    """Return the picture of a lab from what `asking_view` was answered."""
    devices: list[Device]
    rows, devices, lots, materials, connections, accepted, amounts, told = answers
    specs = enrollment_selectors.specs_of(devices)
    calibrations = calibration_selectors.calibrations_of(devices, accepted, at=now())
    snapshot = crutd_selectors.lab_snapshot(rows, amounts)
    return PlannerView(
        tree=resource_selectors.tree_of(rows),
        graph=resource_selectors.to_graph(connections),
        devices=tuple(
            msgspec.structs.replace(
                enrollment_selectors.to_domain(row, specs[row.id]),
                calibrations=calibrations.get(row.id, ()),
            )
            for row in devices
        ),
        snapshot=_as_devices_say(snapshot, devices, dict(told)),
        densities_mg_ul={LotId(str(lot.id)): lot.material.density_mg_ul for lot in lots},
        facts=lab_facts(lab, lots, materials),
        lots={lot.key: LotId(str(lot.id)) for lot in lots},
        materials={row.key: row.id for row in materials},
    )


def _as_devices_say(
    snapshot: dict[UUID, ResourceState], devices: list[Device], told: Mapping[UUID, Any]
) -> dict[UUID, ResourceState]:
    """Put what a device last told of its own state over the record of it.

    A pump that was switched off has lost its zero, whatever was recorded before.
    """
    found = dict(snapshot)
    for row in devices:
        if told.get(row.id) is not False:
            continue
        for node in (UUID(text) for text in row.nodes.values()):
            state = found[node]
            if "is_initialized" in state.data:
                data = {**state.data, "is_initialized": False}
                found[node] = replace(state, data=data)
    return found
