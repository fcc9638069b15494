"""The lab of a graph file, with the devices that its binding gives it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any
from uuid import UUID

from labweb.domain.graph.lab_file.binding_file import BindingFile, read_binding
from labweb.domain.graph.lab_file.lab_model import LabFile, LabFileLot, LabFileMaterial, entry_id
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.recipes.graph_formats.lab_of_any_format import Format, LabDocument
from labweb.domain.resources.contents_by_lot import LotId, Phase, total_nl
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import Nature
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.view_of_lab_file import view_of_file
from tests.domain.workflows.station import specs

ROOT = Path(__file__).parents[1]
DAY = date(2026, 5, 4)
_EVAPORATOR_UL = 1_000_000


@cache
def _binding(format_: Format) -> BindingFile:
    return read_binding((ROOT / f"fixtures/bindings/{format_.value}.json").read_bytes())


def lab_of(raw: bytes, name: str, plan: Mapping[str, Any]) -> LabFile:
    """Return the lab of a graph once a person has filled its flasks as a plan says.

    Args:
        raw: The graph.
        name: What the lab is called where the graph does not say.
        plan: As `docs/plan.md` says it, of a recipe on this graph.

    Raises:
        LabFileError: The graph cannot be read, or is no lab.
    """
    document = LabDocument(raw, name)
    if document.format is Format.LABWEB:
        lab = document.read()
    else:
        lab = document.bound(_binding(document.format))[0]
        for material, vessel, volume_ul in _filled(plan):
            lab = _fill(lab, material, vessel, volume_ul)
        for material, jar in jars_of(plan).items():
            lab = _put_jar(lab, material, jar, plan)
    return _with_sizes(lab)


def _with_sizes(lab: LabFile) -> LabFile:
    """Hang a flask of a litre on each evaporator, and say how much a receiver takes.

    How much is drawn into an evaporator is known only once layers have parted; a smaller flask,
    as some graphs have it, runs over in recipes that were published with it. A receiver takes as
    much as the flask before it, where the graph does not say.
    """
    sizes: dict[UUID, float | None] = {
        one.id: one.config.get("capacity_ul") for one in lab.resources
    }
    gases = [tube for tube in lab.connections if tube.medium is Medium.GAS]
    flasks = {one.id for one in lab.resources if _stands_on_an_evaporator(one, lab)}
    ends = [(one.source.resource_id, one.target.resource_id) for one in gases]
    ways = [pair for pair in ends if pair[0] in flasks]
    for flask, receiver in ways:
        size_ul = sizes[flask]
        if size_ul and not sizes[receiver]:
            sizes[flask] = sizes[receiver] = max(size_ul, _EVAPORATOR_UL)
    return replace(
        lab,
        resources=tuple(
            replace(one, config={**one.config, "capacity_ul": sizes[one.id]})
            if sizes[one.id] != one.config.get("capacity_ul")
            else one
            for one in lab.resources
        ),
    )


def _stands_on_an_evaporator(one: Resource, lab: LabFile) -> bool:
    return one.parent_id is not None and lab.tree.find(one.parent_id).kind == "rotary_evaporator"


def view_of(lab: LabFile) -> PlannerView:
    """Return what the planner sees of a lab on its first day."""
    return view_of_file(lab, specs(), on=DAY)


def jars_of(plan: Mapping[str, Any]) -> dict[str, str]:
    """Return the key of the jar that a person has of each solid of a plan."""
    claims = (step["does"] for step in plan["steps"])
    lots = dict.fromkeys(does["lot"] for does in claims if does["kind"] == "add_solid")
    return {lot: f"jar_{number}" for number, lot in enumerate(lots, start=1)}


def _put_jar(lab: LabFile, name: str, jar: str, plan: Mapping[str, Any]) -> LabFile:
    """Bring a jar in that holds what a plan needs of a solid, and say what its vessels take."""
    claims = [one["does"] for one in plan["steps"] if one["does"]["kind"] == "add_solid"]
    mass_ug = sum(does["mass_ug"] for does in claims if does["lot"] == name)
    targets = {does["to"] for does in claims}
    all_mg = sum(does["mass_ug"] for does in claims) / 1000
    root = next(one for one in lab.resources if one.parent_id is None)
    lab = _held_by_mass(lab, targets, all_mg)
    new = Resource(
        id=entry_id(lab.id, "resource", jar),
        key=jar,
        name=f"Jar of {name}",
        kind="bottle",
        nature=Nature.RESOURCE,
        parent_id=root.id,
        config={"capacity_mg": all_mg},
    )
    materials = {one.key: one for one in lab.materials}
    material = materials.get(
        name, LabFileMaterial(id=entry_id(lab.id, "material", name), key=name, name=name)
    )
    key = f"{jar}/{name}"
    lot = LabFileLot(
        id=entry_id(lab.id, "lot", key), key=key, material_id=material.id, phase=Phase.SOLID
    )
    return replace(
        lab,
        resources=(*lab.resources, new),
        materials=tuple({**materials, name: material}.values()),
        lots=(*lab.lots, lot),
        masses={**lab.masses, new.id: {LotId(str(lot.id)): mass_ug}},
    )


def _held_by_mass(lab: LabFile, vessels: Collection[str], most_mg: float) -> LabFile:
    """Say how much solid vessels take, where nobody has."""
    return replace(
        lab,
        resources=tuple(
            replace(one, config={"capacity_mg": most_mg, **one.config})
            if one.key in vessels
            else one
            for one in lab.resources
        ),
    )


def _filled(plan: Mapping[str, Any]) -> Iterator[tuple[str, str, float]]:
    for does in (step["does"] for step in plan["steps"]):
        if does["kind"] == "fill":
            yield does["lot"], does["to"], does["volume_ul"]


def _fill(lab: LabFile, name: str, vessel: str, volume_ul: float) -> LabFile:
    """Put a new lot of a material into a vessel."""
    known = {one.key: one for one in lab.materials}
    new = LabFileMaterial(id=entry_id(lab.id, "material", name), key=name, name=name)
    material = known.get(name, new)
    key = f"{vessel}/{name}/{len(lab.lots)}"
    lot = LabFileLot(id=entry_id(lab.id, "lot", key), key=key, material_id=material.id)
    place = lab.tree.by_key[vessel].id
    held = {**lab.contents.get(place, {}), LotId(str(lot.id)): round(volume_ul * 1000)}
    # A person who fills in more than a flask takes brings a larger one.
    most_ul = total_nl(held) / 1000
    lab = replace(
        lab,
        resources=tuple(
            replace(one, config={**one.config, "capacity_ul": most_ul})
            if one.id == place and most_ul > one.config.get("capacity_ul", most_ul)
            else one
            for one in lab.resources
        ),
    )
    return replace(
        lab,
        materials=tuple({**known, name: material}.values()),
        lots=(*lab.lots, lot),
        contents={**lab.contents, place: held},
    )
