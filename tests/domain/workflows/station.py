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

from labweb.domain.enrollment.spec import DriverSpec
from labweb.domain.graph.lab_file.model import LabFile
from labweb.domain.graph.lab_file.read import read_lab
from labweb.domain.recipes.xdl.declared import read_declared
from labweb.domain.recipes.xdl.read import read_xdl
from labweb.domain.recipes.xdl.to_workflow import to_workflow
from labweb.domain.recipes.xdl.unfold import unfold
from labweb.domain.resources.contents import LotId
from labweb.domain.workflows.compile import LabView
from labweb.domain.workflows.first_day import view_of_file
from labweb.domain.workflows.protocol import Workflow, parse_workflow, resolve_keys

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
