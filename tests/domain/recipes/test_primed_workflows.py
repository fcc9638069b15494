"""A plan that fills and empties tubes becomes a workflow, and that a run of strokes.

The starter lab with argon at a valve:

    water ▸ valve_1 ◂▸ reactor_1     waste      the tube of the water holds 0.4 mL, the one to the
    argon ▸    ╨ pump_1                         reactor 0.6 mL
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from labweb.domain.crutd.operations import TransferLiquid, Update
from labweb.domain.errors import LabError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.recipes.agreement.check import check_agreement
from labweb.domain.recipes.recipe_preview import PreviewAsked, open_recipe, workflow_from
from labweb.domain.workflows.compile_workflow import compile_workflow
from labweb.domain.workflows.plan import Plan
from labweb.domain.workflows.workflow_file import parse_workflow, resolve_keys
from tests.domain.recipes.plans import claims, recipe
from tests.domain.recipes.test_opening import STARTER
from tests.domain.workflows.station import view_of

VOLUMES_UL = {"water": 400, "reactor_1": 600}
BIND = {"water": "water", "reactor": "reactor_1"}
ADD = 'Add vessel="reactor" reagent="water" volume="{} mL"'
REACTOR = '<Component id="reactor" type="reactor"/>'
PUMPS = ("pump_1", "pump_2")


def lab(*, gas: str = "argon") -> dict[str, Any]:
    found: dict[str, Any] = json.loads(STARTER)
    for tube in found["connections"]:
        ends = {tube[end]["resource"] for end in ("source", "target")}
        for key in ends & VOLUMES_UL.keys():
            tube["dead_volume_ul"] = VOLUMES_UL[key]
    for number in (1, 2):
        bottle = {"key": f"argon_{number}", "name": "Argon", "kind": "bottle", "parent": "bench_1"}
        found["resources"].append(bottle | {"config": {"gas": gas} if gas else {}})
        source = {"resource": f"argon_{number}", "port": "outlet"}
        target = {"resource": f"valve_{number}", "port": "7"}
        one = {"key": f"gas_{number}", "source": source, "target": target}
        found["connections"].append(one | {"medium": "liquid", "is_two_way": False})
    return found


def asked(*steps: str, primes: bool = True) -> PreviewAsked:
    text = recipe(*steps, hardware=REACTOR, reagents=("water",)).encode()
    raw = json.dumps(lab()).encode()
    return PreviewAsked(name="primed", recipe=text, graph=raw, bind=BIND, primes=primes)


def document(*steps: str) -> dict[str, Any]:
    found: dict[str, Any] = workflow_from(asked(*steps))["document"]
    return found


def planned(found: dict[str, Any], graph: dict[str, Any] | None = None) -> Plan:
    file: LabFile = read_lab(json.dumps(graph or lab()).encode())
    return compile_workflow(resolve_keys(parse_workflow(found), file.tree), view_of(file, {}))


def test_what_fills_and_empties_tubes_comes_into_the_workflow() -> None:
    steps = (ADD.format(10), ADD.format(5))
    plan = open_recipe(asked(*steps))["plan"]
    assert [d["kind"] for d in claims(plan)] == ["prime", "transfer", "push", "transfer", "push"]
    found = document(*steps)
    ids = [step["id"] for step in found["steps"]]
    assert ids == ["prime1", "s1", "push1", "s2", "push2"]
    assert found["steps"][0]["params"] == {
        "source": "@water",
        "target": "@waste",
        "volume": "0.8 mL",
        "pump": "@pump_1",
    }
    assert found["steps"][2] == {
        "id": "push1",
        "kind": "push_gas",
        "params": {
            "gas": "@argon_1",
            "target": "@reactor_1",
            "volume": "1.2 mL",
            "pump": "@pump_1",
        },
        "note": found["steps"][2]["note"],
        "position": found["steps"][2]["position"],
    }
    ends = [(edge["source"], edge["target"]) for edge in found["edges"]]
    assert set(ends) >= {("prime1", "s1"), ("s1", "push1"), ("push1", "s2"), ("s2", "push2")}


def test_the_workflow_is_planned_stroke_by_stroke_and_gas_is_no_matter() -> None:
    plan = planned(document(ADD.format(10)))
    moves = [job for job in plan.jobs if job.action in ("aspirate", "dispense")]
    of_gas = [job for job in moves if job.step_id == "push1"]
    assert [(job.action, job.args["volume_ul"]) for job in of_gas] == [
        ("aspirate", 1200.0),
        ("dispense", 1200.0),
    ]
    for job in of_gas:
        assert isinstance(job.operation, Update)
        assert job.operation.needs_empty
        assert {one.name for one in job.pre} >= {"pump.syringe_before", "pump.is_initialized"}
    liquid = [job.operation for job in moves if job.step_id != "push1"]
    assert all(isinstance(one, TransferLiquid) for one in liquid)
    sentences = [step.sentence for step in plan.steps]
    assert "Push 1.2 mL of Argon into Reactor" in " ".join(sentences)


def test_gas_comes_out_of_no_bottle_that_does_not_say_which() -> None:
    with pytest.raises(LabError) as caught:
        planned(document(ADD.format(10)), lab(gas=""))
    assert "plan.no_gas" in {one.code for one in caught.value.findings}


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["steps"].pop(0),
        lambda d: d["steps"].pop(2),
        lambda d: d["steps"][0]["params"].update(volume="0.7 mL"),
        lambda d: d["steps"][2]["params"].update(volume="0.7 mL"),
        lambda d: d["steps"][2]["params"].update(gas="@argon_2"),
        lambda d: d["steps"][2]["params"].update(target="@flask_1"),
        lambda d: d["steps"][1]["params"].update(pump="@pump_2"),
    ],
)
def test_a_workflow_that_fills_or_empties_tubes_otherwise_is_told(
    change: Callable[[dict[str, Any]], object],
) -> None:
    one = asked(ADD.format(10))
    plan, found = open_recipe(one)["plan"], workflow_from(one)["document"]
    assert check_agreement(plan, found, PUMPS) == []
    change(found)
    assert {f.code for f in check_agreement(plan, found, PUMPS)} == {"recipe.differs"}


def test_nothing_is_primed_that_nobody_asks_for() -> None:
    found = workflow_from(asked(ADD.format(10), primes=False))["document"]
    assert [step["id"] for step in found["steps"]] == ["s1"]
