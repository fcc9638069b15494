"""The station for organic synthesis as the compiler sees it, straight from its files."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.recipes.xdl.as_workflow.recipe_to_workflow import to_workflow
from labweb.domain.recipes.xdl.file_format.read_xdl import read_xdl
from labweb.domain.recipes.xdl.lab_choices.declarations_file import read_declared
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.workflows.compile_workflow import PlannerView
from labweb.domain.workflows.view_of_lab_file import view_of_file
from labweb.domain.workflows.workflow_file import Workflow, parse_workflow, resolve_keys

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


def in_a_chain() -> dict[str, Any]:
    """Return the lab file with its valves in a chain: valve to valve, each with its own syringe.

    The reactor hangs at the first valve alone, the evaporating flask at the third: what goes from
    one to the other is handed on from syringe to syringe.
    """
    found: dict[str, Any] = json.loads((LAB / "lab.json").read_text("utf-8"))
    gone = {"valve_2_1_reactor", "valve_4_2_reactor", "valve_4_1_rotavap_flask", "valve_2_8_waste"}
    kept = [one for one in found["connections"] if one["key"] not in gone]
    joined = (("valve_1", "9", "valve_2", "9"), ("valve_2", "7", "valve_3", "9"))
    for one, port, other, far in (*joined, ("valve_3", "7", "valve_4", "9")):
        ends = {"resource": one, "port": port}, {"resource": other, "port": far}
        tube = {"key": f"{one}_{other}", "source": ends[0], "target": ends[1], "medium": "liquid"}
        kept.append({**tube, "is_two_way": True, "dead_volume_ul": 150})
    return {**found, "connections": kept}


def station(**contents_ul: dict[str, float]) -> PlannerView:
    """Return the station on its first day; vessels that are named hold something else."""
    return view_of(station_file(), contents_ul)


def view_of(lab: LabFile, contents_ul: Mapping[str, Mapping[str, float]]) -> PlannerView:
    """Return a lab on its first day; vessels that are named hold something else."""
    lots = {lot.key: LotId(str(lot.id)) for lot in lab.lots}
    other = {
        lab.tree.by_key[key].id: {lots[lot]: round(ul * 1000) for lot, ul in held.items()}
        for key, held in contents_ul.items()
    }
    held = replace(lab, contents={**lab.contents, **other})
    return view_of_file(held, specs(), on=date(2026, 5, 4))


def recipe_document() -> dict[str, Any]:
    """Turn the recipe and what is declared beside it into a workflow."""
    recipe = read_xdl(RECIPE.read_bytes())
    declared = read_declared(DECLARED.read_bytes())
    return to_workflow(unfold(recipe), name="Benzhydryl acetate", declared=declared)


def workflow(document: dict[str, Any]) -> Workflow:
    return resolve_keys(parse_workflow(document), station_file().tree)
