"""What a proved plan takes for granted of the flasks it draws from, and whether it still holds.

A plan is proved for what stands in the lab when it is made. A run begins later, and a workflow
names vessels, not what is in them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.model import LabFile
from labweb.domain.workflows.passes.view import LabView

Proved = Mapping[str, Any]
"""`recipe_sha256`, `graph_sha256`, and `sources`: resource id → `reagent` of the recipe and the
keys of the `materials` that it was."""


def render_proved(told: Mapping[str, Any], lab: LabFile) -> dict[str, Any]:
    """Return what is kept of a proof beside the workflow.

    Args:
        told: `recipe_sha256`, `graph_sha256`, and `sources`: key of a vessel → reagent.
        lab: The lab that the plan was proved on.
    """
    ids = {resource.key: resource.id for resource in lab.resources}
    keys = {lot: lab.materials_by_id[one.material_id].key for lot, one in lab.lots_by_id.items()}
    sources = {}
    for key, reagent in told["sources"].items():
        held = lab.contents.get(ids[key], {})
        materials = sorted({keys[lot] for lot in held})
        sources[str(ids[key])] = {"reagent": reagent, "materials": materials}
    return {**told, "sources": sources}


def check_sources(proved: Proved, lab: LabView) -> list[Finding]:
    """List the flasks that hold another material than the plan was proved with.

    One that was empty then is one of these as soon as anything is in it: nobody has compared
    that with the recipe.
    """
    findings = []
    for resource_id, told in sorted(proved["sources"].items()):
        there = _materials(lab, UUID(resource_id))
        if there <= set(told["materials"]):
            continue
        name = lab.names.get(resource_id, resource_id)
        was = ", ".join(told["materials"]) or "nothing"
        message = (
            f"{name} is to give {told['reagent']}, and held {was} when that was proved; it holds "
            f"{', '.join(sorted(there))}: open the recipe and save it anew"
        )
        context = {"resource_id": resource_id, "reagent": told["reagent"]}
        findings.append(Finding("recipe.other_content", message, "", context))
    return findings


def _materials(lab: LabView, resource_id: UUID) -> set[str]:
    state, facts = lab.state(resource_id), lab.facts
    if state is None or facts is None:
        return set()
    return {facts.lots[lot].material.key for lot, amount in state.contents.items() if amount}
