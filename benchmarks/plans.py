"""A workflow planned and proved, beside bare shortest paths between the same vessels.

`python -m benchmarks plans`: fifty transfers in a row on the starter lab, and the longest
workflow of the package, the synthesis on its station.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import rustworkx

from benchmarks.figures import Figure, report
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.workflows.compile_workflow import compile_workflow
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.plan_proof.prove_workflow import prove_plan
from labweb.domain.workflows.workflow_file import Workflow, parse_workflow, resolve_keys
from tests.domain.workflows import station

TRANSFERS_COUNT = 50
LIMIT_MS, LONGEST_MS = 300.0, 2000.0
ROUNDS_COUNT = 5
STARTER = Path(__file__).parents[1] / "fixtures/labs/starter/lab.json"
ENDS = (("water", "reactor_1"), ("reactor_1", "waste"))


def main() -> int:
    """Measure, and print each figure beside its limit."""
    return report("plans", figures())


def figures() -> Iterator[Figure]:
    """Yield what was measured."""
    name = f"{TRANSFERS_COUNT} transfers"
    # Reactor 1 gives what is above its dead volume.
    held = {"reactor_1": {"water_lot": 1000.0}}
    view = station.view_of(read_lab(STARTER.read_bytes()), held)
    yield from _of(name, _row(TRANSFERS_COUNT, view), view, LIMIT_MS)
    paths = _ms(_paths(TRANSFERS_COUNT, view))
    yield Figure(name=f"{name}: bare shortest paths", value=paths, unit="ms")
    longest = station.workflow(station.recipe_document())
    name = f"synthesis of {len(longest.steps)} steps"
    yield from _of(name, longest, station.station(), LONGEST_MS)


def _of(name: str, workflow: Workflow, view: PlannerView, limit: float) -> Iterator[Figure]:
    plan = compile_workflow(workflow, view)
    proof = prove_plan(workflow, plan, view)
    if proof.findings or proof.beyond:
        raise RuntimeError(f"{name}: not proved: {proof.findings or proof.beyond}")
    planned = _ms(lambda: compile_workflow(workflow, view))
    proved = _ms(lambda: prove_plan(workflow, plan, view))
    yield Figure(name=f"{name}: jobs", value=len(plan.jobs), unit="")
    yield Figure(name=f"{name}: planned", value=planned, unit="ms")
    yield Figure(name=f"{name}: proved", value=proved, unit="ms")
    yield Figure(name=f"{name}: planned and proved", value=planned + proved, unit="ms", limit=limit)


def _row(size: int, view: PlannerView) -> Workflow:
    """Return transfers one after another, to and fro, so that nothing runs dry or over."""
    steps: list[dict[str, Any]] = []
    for place in range(size):
        source, target = ENDS[place % len(ENDS)]
        params = {"source": f"@{source}", "target": f"@{target}", "volume": "1 mL"}
        steps.append({"id": f"t{place}", "kind": "transfer", "params": params})
    edges = [
        {"id": f"e{place}", "source": one["id"], "source_port": "done"}
        | {"target": two["id"], "target_port": "start"}
        for place, (one, two) in enumerate(pairwise(steps))
    ]
    document = {"schema": "labweb.workflow/1", "name": "Row", "steps": steps, "edges": edges}
    return resolve_keys(parse_workflow(document), view.tree)


def _paths(size: int, view: PlannerView) -> Callable[[], object]:
    graph: rustworkx.PyGraph[object, None] = rustworkx.PyGraph()
    places = {one.id: graph.add_node(one.id) for one in view.tree.resources}
    for tube in view.graph.connections:
        graph.add_edge(places[tube.source.resource_id], places[tube.target.resource_id], None)
    keys = {one.key: places[one.id] for one in view.tree.resources}
    pairs = [ENDS[place % len(ENDS)] for place in range(size)]

    def search() -> None:
        for source, target in pairs:
            rustworkx.dijkstra_shortest_paths(graph, keys[source], target=keys[target])

    return search


def _ms(act: Callable[[], object]) -> float:
    """Return how long it takes, in the time of this process alone: others may be busy."""
    taken = []
    for _ in range(ROUNDS_COUNT):
        begun = time.process_time()
        act()
        taken.append(1000 * (time.process_time() - begun))
    return median(taken)
