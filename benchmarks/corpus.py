"""Every recipe of a folder on its rig: compiled, proved, would it start, does it run to its end?

`python -m benchmarks.corpus FOLDER [--start] [--run] [--speed N]` prints one line of JSON for each
recipe beside a rig (`corpus_pairs`), and the totals last. Without `--run` no database is asked, and
nothing moves; with it each recipe that would start is run in a lab of its own (`corpus_run`).

Compiled and proved is what `manage.py compile_protocol` does. To start, the recipe becomes the
workflow that a browser would save of it, with the vessels and flasks of that plan; the graph
becomes a lab (`corpus_lab`) in which a person has filled the flasks as the plan says; and the
workflow is planned and proved there as the server does at each start. A recipe without a proved
plan is not started.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from benchmarks.corpus_lab import jars_of, lab_of, view_of
from benchmarks.corpus_pairs import Pair, find_pairs, find_traces
from benchmarks.corpus_run import Ran, run_on_lab
from benchmarks.corpus_volumes import Compared, compare, nodes_of, of_events, read_trace
from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.rig.lab_as_rig import render_graph
from labweb.domain.graph.rig.rig_read import read_rig, unpacked
from labweb.domain.recipes.compile_recipe_file import digest, plan_recipe, read_recipe
from labweb.domain.recipes.recipe_preview import PreviewAsked, workflow_from
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe, XdlStep
from labweb.domain.workflows.compile_workflow import compile_workflow
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.plan_proof.prove_workflow import WorkflowProof, prove_plan
from labweb.domain.workflows.workflow_file import parse_workflow, resolve_keys

_UNPROVED = "plan.not_proved"


@dataclass(kw_only=True)
class Judged:
    """What became of one recipe on its rig."""

    is_compiled: bool = False
    is_proved: bool = False
    is_started: bool | None = None
    """None: nobody tried."""

    ran: Ran | None = None
    """None: nobody ran it."""

    compared: Compared | None = None
    """What reached the vessels beside what should have; None: it did not come to its end."""

    beyond_count: int = 0
    """Steps of the workflow that change matter and that no proof covers."""

    findings: list[dict[str, str]] = field(default_factory=list)

    def to_json(self, pair: Pair, folder: Path) -> dict[str, Any]:
        """Render one line. `ran` is None: it was not run."""
        is_run = None if self.ran is None else self.ran.is_complete
        return {
            "recipe": str(pair.recipe.relative_to(folder)),
            "rig": str(pair.rig.relative_to(folder)),
            "compiled": self.is_compiled,
            "proved": self.is_proved,
            "started": self.is_started,
            "ran": is_run,
            **({} if self.ran is None else self.ran.to_json()),
            **({} if self.compared is None else self.compared.to_json()),
            "findings": self.findings,
        }


def main(arguments: list[str] | None = None) -> int:
    """Judge a folder; exit code 2 when it is none, or holds no recipe beside a rig."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.corpus",
        description="Compile and prove every recipe of a folder on the rig beside it.",
    )
    parser.add_argument("folder", type=Path, help="folder of recipes beside their rigs")
    parser.add_argument("--start", action="store_true", help="plan each as a start would")
    parser.add_argument(
        "--run", action="store_true", help="run what starts, each in a lab of its own"
    )
    parser.add_argument(
        "--speed", type=float, default=100.0, help="simulated seconds per second (100)"
    )
    options = parser.parse_args(arguments)
    pairs = find_pairs(options.folder) if options.folder.is_dir() else []
    if not pairs:
        sys.stderr.write(f"{options.folder}: no recipe lies there beside a rig\n")
        return 2
    told = []
    traces = find_traces(options.folder) if options.run else {}
    for pair in pairs:
        speed = options.speed if options.run else None
        is_started = options.start or options.run
        told.append(judge(pair, is_started=is_started, speed=speed, trace=traces.get(pair)))
        print(json.dumps(told[-1].to_json(pair, options.folder), ensure_ascii=False), flush=True)
    print(json.dumps({"totals": totals(told)}, ensure_ascii=False))
    return 0


def judge(
    pair: Pair, *, is_started: bool, speed: float | None = None, trace: Path | None = None
) -> Judged:
    """Compile one recipe, prove its plan, and start it on paper if that is asked.

    With a speed, in simulated seconds per second, what would start is run to its end as well, and
    what reached the vessels is held against a trace, or against the recipe's own amounts.
    """
    judged = Judged()
    recipe = None
    try:
        recipe = _read(pair)
        plan = _plan(pair, recipe)
    except LabError as error:
        judged.is_compiled = error.code == _UNPROVED
        judged.findings += _told("compile", error, _steps_of(recipe))
        return judged
    judged.is_compiled = judged.is_proved = True
    if is_started:
        started = _start(pair, plan, recipe, judged)
        if started is not None and speed is not None:
            judged.ran = run_on_lab(*started, speed=speed)
            judged.findings += judged.ran.findings
            judged.compared = _compare(pair, plan, judged.ran, trace)
    return judged


def _compare(pair: Pair, plan: Mapping[str, Any], ran: Ran, trace: Path | None) -> Compared | None:
    if not ran.is_complete:
        return None
    nodes = nodes_of(pair)
    moved = of_events(ran.moves, ran.keys, nodes)
    return compare(plan, nodes, None if trace is None else read_trace(trace), moved)


def compiled(pair: Pair) -> tuple[Recipe, dict[str, Any]]:
    """Return a recipe and its plan on its rig, proved.

    Raises:
        LabError: It cannot be read, or there is no proved plan.
    """
    recipe = _read(pair)
    return recipe, _plan(pair, recipe)


def _read(pair: Pair) -> Recipe:
    asked = _asked(pair)
    return read_recipe(asked.recipe, read_rig(unpacked(asked.graph)))


def _plan(pair: Pair, recipe: Recipe) -> dict[str, Any]:
    asked = _asked(pair)
    graph = unpacked(asked.graph)
    wish = asked.wish(recipe, asked.stated())
    return plan_recipe(recipe, read_rig(graph), wish, asked.head(digest(graph))).plan


def _asked(pair: Pair, bind: Mapping[str, str] | None = None) -> PreviewAsked:
    declared = pair.declared()
    return PreviewAsked(
        name=pair.recipe.stem,
        recipe=pair.recipe.read_bytes(),
        graph=pair.rig.read_bytes(),
        declared=b"" if declared is None else declared.read_bytes(),
        bind=bind or {},
    )


def on_lab(pair: Pair, plan: Mapping[str, Any], recipe: Recipe) -> tuple[LabFile, PreviewAsked]:
    """Return the lab of a rig as a person has filled it, and the recipe as it is opened there.

    Raises:
        LabFileError: The graph is no lab.
    """
    lab = lab_of(unpacked(pair.rig.read_bytes()), pair.recipe.stem, plan)
    asked = replace(_asked(pair, _bound(plan, recipe)), graph=render_graph(lab), is_of_lab=True)
    return lab, asked


def _start(
    pair: Pair, plan: Mapping[str, Any], recipe: Recipe, judged: Judged
) -> tuple[LabFile, dict[str, Any]] | None:
    """Return the lab and the workflow that would start; None: it would not."""
    names = _steps_of(recipe)
    try:
        lab, asked = on_lab(pair, plan, recipe)
        document = workflow_from(asked)["document"]
        names |= {step["id"]: step["kind"] for step in document["steps"]}
        proof = _proved(document, view_of(lab))
    except LabError as error:
        judged.is_started = False
        judged.findings += _told("start", error, names)
        return None
    judged.is_started, judged.beyond_count = True, len(proof.beyond)
    return lab, document


def _bound(plan: Mapping[str, Any], recipe: Recipe) -> dict[str, str]:
    """Return the vessel or flask of each name that one alone stands for, as far as declared."""
    bound = {**plan["bindings"]["vessels"], **plan["bindings"]["reagents"]}
    declared = {one.id for one in recipe.synthesis.hardware}
    declared |= {one.id for one in recipe.synthesis.reagents}
    found = {n: key for n, key in bound.items() if isinstance(key, str) and n in declared}
    return found | {lot: key for lot, key in jars_of(plan).items() if lot in declared}


def _proved(document: dict[str, Any], view: PlannerView) -> WorkflowProof:
    workflow = resolve_keys(parse_workflow(document), view.tree)
    proof = prove_plan(workflow, compile_workflow(workflow, view), view)
    proof.require()
    return proof


def _told(at: str, error: LabError, names: Mapping[str, str]) -> list[dict[str, str]]:
    findings = error.findings or (Finding(error.code, error.message),)
    return [
        {
            "at": at,
            "code": one.code,
            "message": one.message,
            "step": names.get(str(one.context.get("line", "")), names.get(one.subject, "")),
            "subject": one.subject,
        }
        for one in findings
    ]


def _steps_of(recipe: Recipe | None) -> dict[str, str]:
    """Return the name of the step in each line, or at each path, of a recipe."""
    if recipe is None:
        return {}
    procedures = [*recipe.syntheses, *recipe.blueprints.values()]
    steps = [step for one in procedures for step in _all(one.steps)]
    lines = {str(step.place.line): step.name for step in steps if step.place.line}
    return lines | {str(step.place): step.name for step in steps}


def _all(steps: Iterable[XdlStep]) -> Iterator[XdlStep]:
    for step in steps:
        yield step
        yield from _all(step.children)


def totals(judged: list[Judged]) -> dict[str, Any]:
    """Count, and rank what refuses: where, by which code, at which step, of how many recipes."""
    refusals = Counter(
        told for one in judged for told in {(f["at"], f["code"], f["step"]) for f in one.findings}
    )
    ranked = sorted(refusals.items(), key=lambda entry: (-entry[1], entry[0]))
    return {
        "pairs": len(judged),
        "compiled": sum(one.is_compiled for one in judged),
        "proved": sum(one.is_proved for one in judged),
        "started": sum(one.is_started is True for one in judged),
        "ran": sum(one.ran is not None and one.ran.is_complete for one in judged),
        "steps_beyond_proof": sum(one.beyond_count for one in judged),
        "refusals": [
            {"at": at, "code": code, "step": step, "recipes": count}
            for (at, code, step), count in ranked
        ],
    }


if __name__ == "__main__":
    sys.exit(main())
