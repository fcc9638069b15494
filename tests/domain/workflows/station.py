"""The station for organic synthesis as the compiler sees it, straight from its files."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from labweb.domain.crutd.snapshot import Facts, LotState, MaterialState, ResourceState
from labweb.domain.enrollment.device import Device
from labweb.domain.enrollment.spec import DriverSpec
from labweb.domain.graph.lab_file.model import LabFile
from labweb.domain.graph.lab_file.read import read_lab
from labweb.domain.resources.contents import LotId
from labweb.domain.workflows.compile import LabView
from labweb.domain.workflows.protocol import Workflow, parse_workflow, resolve_keys
from labweb.domain.workflows.xdl.declared import read_declared
from labweb.domain.workflows.xdl.read import read_xdl
from labweb.domain.workflows.xdl.to_workflow import to_workflow
from labweb.domain.workflows.xdl.unfold import unfold

ROOT = Path(__file__).parents[3]
LAB = ROOT / "fixtures/labs/organic_synthesis"
RECIPE = LAB / "protocols/benzhydryl_acetate.xdl"
DECLARED = RECIPE.with_suffix(".declared.json")


@cache
def specs() -> dict[str, DriverSpec]:
    """Read the drivers as the server does: as text, in a process of its own."""
    command = [sys.executable, "-m", "drivers.catalog", "--json"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout
    found = msgspec.convert(json.loads(told)["drivers"], list[DriverSpec])
    return {f"{spec.module}:{spec.class_name}": spec for spec in found}


@cache
def station_file() -> LabFile:
    return read_lab((LAB / "lab.json").read_bytes())


def station(**contents_ul: dict[str, float]) -> LabView:
    """Return the station on its first day; vessels that are named hold something else."""
    return view_of(station_file(), contents_ul)


def view_of(lab: LabFile, contents_ul: Mapping[str, Mapping[str, float]]) -> LabView:
    """Return a lab on its first day; vessels that are named hold something else."""
    lots = {lot.key: LotId(str(lot.id)) for lot in lab.lots}
    other = {
        key: {lots[lot]: round(ul * 1000) for lot, ul in held.items()}
        for key, held in contents_ul.items()
    }
    materials = {
        one.id: MaterialState(key=one.key, name=one.name, density_mg_ul=one.density_mg_ul)
        for one in lab.materials
    }
    states = {
        one.id: ResourceState(
            id=one.id,
            name=one.name,
            kind=one.kind,
            parent_id=one.parent_id,
            contents=other.get(one.key, lab.contents.get(one.id, {})),
            capacity_nl=_nl(one.config.get("capacity_ul")),
        )
        for one in lab.resources
    }
    return LabView(
        tree=lab.tree,
        graph=lab.graph,
        devices=tuple(
            Device(
                id=entry.id,
                key=entry.key,
                name=entry.name,
                host_id=entry.host_id,
                spec=specs()[entry.driver],
                transport="",
                config=dict(entry.config),
                nodes=dict(entry.nodes),
            )
            for entry in lab.devices
        ),
        snapshot=states,
        densities_mg_ul={
            lots[x.key]: lab.materials_by_id[x.material_id].density_mg_ul for x in lab.lots
        },
        facts=Facts(
            on=date(2026, 5, 4),
            lots={
                lots[x.key]: LotState(
                    id=lots[x.key], name=x.key, phase=x.phase, material=materials[x.material_id]
                )
                for x in lab.lots
            },
            materials=materials,
        ),
        lots=lots,
        materials={one.key: one.id for one in lab.materials},
    )


def _nl(capacity_ul: float | None) -> int | None:
    return None if capacity_ul is None else round(capacity_ul * 1000)


def recipe_document() -> dict[str, Any]:
    """Turn the recipe and what is declared beside it into a workflow."""
    recipe = read_xdl(RECIPE.read_bytes())
    declared = read_declared(DECLARED.read_bytes())
    return to_workflow(unfold(recipe), name="Benzhydryl acetate", declared=declared)


def workflow(document: dict[str, Any]) -> Workflow:
    return resolve_keys(parse_workflow(document), station_file().tree)
