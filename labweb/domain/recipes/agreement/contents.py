"""What a proved plan takes for granted of the vessels it binds, and whether it still holds.

A plan is proved for what stands in the lab when it is made. A run begins later, and a workflow
names vessels, not what is in them.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from typing import Any
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.workflows.passes.lab_view import PlannerView

Proved = Mapping[str, Any]
"""`recipe_sha256`, `graph_sha256`, and `sources`: resource id → `reagent` of the recipe and the
keys of the `materials` that it was; `vessels`: resource id of each other vessel that the plan
binds → its `materials`. A proof of before has no `vessels`."""


def render_proved(told: Mapping[str, Any], lab: LabFile) -> dict[str, Any]:
    """Return what is kept of a proof beside the workflow.

    Args:
        told: `recipe_sha256`, `graph_sha256`, `sources`: key of a vessel → reagent, and
            `vessels`: keys of the others that the plan binds.
        lab: The lab that the plan was proved on.
    """
    ids = {resource.key: resource.id for resource in lab.resources}
    keys = {lot: lab.materials_by_id[one.material_id].key for lot, one in lab.lots_by_id.items()}

    def held(key: str) -> list[str]:
        return sorted({keys[lot] for lot, nl in lab.contents.get(ids[key], {}).items() if nl})

    sources = {
        str(ids[key]): {"reagent": reagent, "materials": held(key)}
        for key, reagent in told["sources"].items()
    }
    vessels = {str(ids[key]): {"materials": held(key)} for key in told["vessels"]}
    return {**told, "sources": sources, "vessels": vessels}


def check_contents(
    proved: Proved, lab: PlannerView, among: Container[UUID] | None = None
) -> list[Finding]:
    """List the vessels that hold another material than the plan was proved with.

    A flask that is drawn from may have been emptied: how much is left, the plan of the run says.
    One that was empty is one of these as soon as anything is in it: nobody has compared that
    with the recipe. Any other vessel holds what it held, neither more nor less.

    Args:
        proved: What was kept of the proof; vessels that it does not tell of are not compared.
        lab: The lab as it is.
        among: Compare these vessels only; None: all.
    """
    found = [*_sources(proved, lab), *_vessels(proved, lab)]
    return [one for one in found if among is None or UUID(one.context["resource_id"]) in among]


def _sources(proved: Proved, lab: PlannerView) -> Iterator[Finding]:
    for resource_id, told in sorted(proved["sources"].items()):
        there = _materials(lab, UUID(resource_id))
        if not there <= set(told["materials"]):
            does = f"is to give {told['reagent']}, and"
            yield _finding(resource_id, does, told, there, lab)


def _vessels(proved: Proved, lab: PlannerView) -> Iterator[Finding]:
    for resource_id, told in sorted(proved.get("vessels", {}).items()):
        there = _materials(lab, UUID(resource_id))
        if there != set(told["materials"]):
            yield _finding(resource_id, "is a vessel of the recipe, and", told, there, lab)


def _finding(
    resource_id: str, does: str, told: Mapping[str, Any], there: set[str], lab: PlannerView
) -> Finding:
    name = lab.names.get(resource_id, resource_id)
    was = ", ".join(told["materials"]) or "nothing"
    message = (
        f"{name} {does} held {was} when that was proved; it holds "
        f"{', '.join(sorted(there)) or 'nothing'}: put that right, or open the recipe and save it "
        "anew"
    )
    reagent = {"reagent": told["reagent"]} if "reagent" in told else {}
    return Finding("recipe.other_content", message, "", {"resource_id": resource_id, **reagent})


def _materials(lab: PlannerView, resource_id: UUID) -> set[str]:
    state, facts = lab.state(resource_id), lab.facts
    if state is None or facts is None:
        return set()
    return {facts.lots[lot].material.key for lot, amount in state.contents.items() if amount}
