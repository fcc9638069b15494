"""A lab file as the compiler sees it on its first day: what a server reads once it is imported.

It is for whoever plans without a database: nothing has moved yet, and every device of the file is
taken as admitted.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date

from labweb.domain.crutd.snapshot import Facts, LotState, MaterialState, ResourceState
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource import Resource
from labweb.domain.workflows.passes.lab_view import PlannerView


def view_of_file(lab: LabFile, specs: Mapping[str, DriverSpec], *, on: date) -> PlannerView:
    """Return a lab as its file has it.

    Args:
        lab: The file.
        specs: Driver by its name, `module:class`; has each that the file names.
        on: The day, which lots expire on.

    Raises:
        KeyError: A driver is not among the specs.

    Effect:
        None.
    """
    materials = {
        one.id: MaterialState(
            key=one.key,
            name=one.name,
            groups=frozenset(one.groups),
            incompatible_with=frozenset(one.incompatible_with),
            density_mg_ul=one.density_mg_ul,
        )
        for one in lab.materials
    }
    lots = {
        LotId(str(one.id)): LotState(
            id=LotId(str(one.id)),
            name=one.key,
            phase=one.phase,
            material=materials[one.material_id],
            expires_on=None if one.expires_on is None else date.fromisoformat(one.expires_on),
        )
        for one in lab.lots
    }
    return PlannerView(
        tree=lab.tree,
        graph=lab.graph,
        devices=tuple(
            AdmittedDevice(
                id=entry.id,
                key=entry.key,
                name=entry.name,
                host_id=entry.host_id,
                spec=specs[entry.driver],
                transport=entry.transport or "",
                config=dict(entry.config),
                nodes=dict(entry.nodes),
            )
            for entry in lab.devices
        ),
        snapshot={one.id: _state(one, lab) for one in lab.resources},
        densities_mg_ul={key: lot.material.density_mg_ul for key, lot in lots.items()},
        facts=Facts(on=on, lots=lots, materials=materials),
        lots={lot.name: key for key, lot in lots.items()},
        materials={one.key: one.id for one in lab.materials},
    )


def _state(one: Resource, lab: LabFile) -> ResourceState:
    return ResourceState(
        id=one.id,
        name=one.name,
        kind=one.kind,
        parent_id=one.parent_id,
        contents=lab.contents.get(one.id, {}),
        masses=lab.masses.get(one.id, {}),
        capacity_nl=_thousandfold(one.config.get("capacity_ul")),
        capacity_ug=_thousandfold(one.config.get("capacity_mg")),
        dead_volume_nl=_thousandfold(one.config.get("dead_volume_ul")) or 0,
        data=one.data,
    )


def _thousandfold(value: object) -> int | None:
    """Return a figure in the finer unit; what is no number states nothing."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return round(value * 1000)
