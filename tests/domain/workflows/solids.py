"""The station with a filter where its separator stands: a solid in it, vacuum on it, and a trap.

```text
        argon                 stirrer
                                 │
water brine ether ──V2──bottom│filter: salt, ether│top ══ vacuum
                                                   └──▸ crude, as a trap
```
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from typing import Any

from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.workflows.compile_workflow import PlannerView, check_plan, compile_workflow
from labweb.domain.workflows.plan import Plan
from labweb.domain.workflows.plan_proof.prove_workflow import WorkflowProof, prove_plan
from labweb.domain.workflows.workflow_file import Workflow, parse_workflow, resolve_keys
from tests.domain.workflows.station import LAB, view_of

WET = {"separator": {"ether": 30_000.0}}


@cache
def filter_raw(*, is_plain: bool = False, port: str = "bottom") -> bytes:
    """Return the file of the lab; its one vacuum is on the filter, and not on the evaporator."""
    plain = json.loads((LAB / "lab.json").read_text("utf-8"))
    plain["materials"].append({"key": "sodium_chloride", "name": "Sodium chloride"})
    salt = {"key": "salt", "material": "sodium_chloride", "phase": "solid"}
    sand = {"key": "sand", "material": "sodium_chloride", "phase": "solid"}
    plain["lots"] += [salt, sand]
    (vessel,) = (one for one in plain["resources"] if one["key"] == "separator")
    vessel["kind"] = "filter"
    vessel["config"]["capacity_mg"] = 100_000
    if not is_plain:
        vessel["masses"] = [{"lot": "salt", "amount_mg": 500}]
    for one in plain["connections"]:
        for end in (one["source"], one["target"]):
            if end == {"resource": "separator", "port": "bottom"}:
                end["port"] = port
    top = {"resource": "separator", "port": "top"}
    kept = [one for one in plain["connections"] if one["key"] != "vacuum_rotavap_rotavap_flask"]
    plain["connections"] = [
        *kept,
        _joined("suction", {"resource": "vacuum_rotavap", "port": "inlet"}, top, "vacuum"),
        _joined("trap", top, {"resource": "crude", "port": "vapour"}, "gas"),
    ]
    return json.dumps(plain).encode()


@cache
def filter_file(*, is_plain: bool = False, port: str = "bottom") -> LabFile:
    return read_lab(filter_raw(is_plain=is_plain, port=port))


def _joined(key: str, source: dict[str, str], target: dict[str, str], medium: str) -> Any:  # noqa: ANN401 - an entry of the file
    ends = {"source": source, "target": target, "medium": medium}
    return {"key": key, **ends, "is_two_way": medium != "gas", "dead_volume_ul": None}


def filter_lab(
    contents_ul: Mapping[str, Mapping[str, float]] | None = None, lab: LabFile | None = None
) -> PlannerView:
    return view_of(lab or filter_file(), contents_ul or {})


def steps(*made: tuple[str, dict[str, Any]]) -> dict[str, Any]:
    """Return a workflow of these steps, one after the other."""
    rows = [
        {"id": f"s{n}", "kind": kind, "params": params, "position": {"x": 0, "y": 0}}
        for n, (kind, params) in enumerate(made)
    ]
    edges = [
        {"id": f"e{n}", "source": f"s{n}", "source_port": "done"}
        | {"target": f"s{n + 1}", "target_port": "start"}
        for n in range(len(rows) - 1)
    ]
    return {"schema": "labweb.workflow/1", "name": "Solids", "steps": rows, "edges": edges}


def filtering(**more: Any) -> tuple[str, dict[str, Any]]:  # noqa: ANN401 - what a step takes
    params = {"vessel": "@separator", "target": "@waste", "stays": {"salt": "all"}}
    return "filter", {**params, **more}


def drying(**more: Any) -> tuple[str, dict[str, Any]]:  # noqa: ANN401 - what a step takes
    params = {"vessel": "@separator", "pressure": "400 mbar", "duration": "10 min"}
    return "dry", {**params, **more}


def on(document: dict[str, Any], lab: LabFile | None = None) -> Workflow:
    return resolve_keys(parse_workflow(document), (lab or filter_file()).tree)


def planned(document: dict[str, Any], view: PlannerView) -> tuple[Plan, WorkflowProof]:
    """Plan a workflow, and prove its plan."""
    workflow = on(document)
    plan = compile_workflow(workflow, view)
    return plan, prove_plan(workflow, plan, view)


def codes(document: dict[str, Any], view: PlannerView) -> set[str]:
    return {finding.code for finding in check_plan(on(document), view)}
