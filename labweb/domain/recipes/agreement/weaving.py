"""The rinses of a proved plan, and what fills and empties its tubes, written into the workflow.

A recipe does not say where its lines are rinsed or primed: the plan of a rig does. So that comes
into the workflow from there, before the same deed, and each transfer then names its pump, because
it is that syringe which is clean, and that tube which is full. So it does where some lots must not
meet: what is left in the syringes was proved of those.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

from labweb.domain.recipes.agreement.deeds import PRIME, PUSH, RINSE, Deed
from labweb.domain.recipes.agreement.meant import deeds_of_workflow
from labweb.domain.recipes.agreement.proved import deeds_of_plan
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS

_NL_PER_ML = 1_000_000
_NOTES = {
    RINSE: "rinses the lines, as the plan on this rig does before the next step",
    PRIME: "fills the tube of a flask, as the plan on this rig does before the next step",
    PUSH: "pushes what is left in the tube into the vessel, as the plan on this rig does",
}
_TOP, _PITCH = 80.0, 120.0
"""Where the first step stands on the canvas, and how far below it the next."""


def weave_rinses(plan: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a workflow with the rinses of a plan in it; as it is, where nothing is rinsed.

    Args:
        plan: As `docs/plan.md` says it, proved.
        document: The workflow of the same recipe, its vessels as `@key`. One that does anything
            else than the plan beside the rinses is returned as it is: `check_same` tells of it.
    """
    proved, meant = deeds_of_plan(plan), list(deeds_of_workflow(document))
    others = [deed for deed in proved if not deed.added]
    is_bare = len(others) == len(proved) and not plan.get("keeps_apart")
    if is_bare or [d.what for d in others] != [d.what for d in meant]:
        return dict(document)
    before: dict[str, list[Deed]] = {}
    coming = iter(meant)
    held: list[Deed] = []
    for deed in proved:
        if deed.added:
            held.append(deed)
            continue
        owner = str(next(coming).place.get("step", ""))
        before.setdefault(owner, []).extend(held)
        held = []
    steps = [_with_pump(step, others, meant) for step in document["steps"]]
    woven = _Woven([], list(document["edges"]))
    for step in steps:
        woven.put(step, before.get(step["id"], []))
    woven.end(before.get("", []))
    return {**document, "steps": woven.placed(), "edges": woven.edges}


def _with_pump(
    step: dict[str, Any], proved: Sequence[Deed], meant: Sequence[Deed]
) -> dict[str, Any]:
    """Name the pump that the plan takes for a step that moves liquid, where it is one."""
    if STEP_KINDS[step["kind"]].parameter("pump") is None:
        return step
    own = (
        one.pumps
        for one, other in zip(proved, meant, strict=True)
        if other.place.get("step") == step["id"] and one.pumps
    )
    pumps = next(own, ())
    if len(pumps) != 1:
        return step
    return {**step, "params": {**step["params"], "pump": f"@{pumps[0]}"}}


class _Woven:
    """Steps and edges while rinses are put between them."""

    def __init__(self, steps: list[dict[str, Any]], edges: list[dict[str, Any]]) -> None:
        self.steps = steps
        self.edges = edges
        self._counts = Counter[str]()

    def put(self, step: dict[str, Any], rinses: Sequence[Deed]) -> None:
        """Append a step behind its rinses, which wait for what it waited for."""
        first = ""
        last = ""
        for deed in rinses:
            made = self._rinse(deed)
            first = first or made["id"]
            if last:
                self._wait(last, made["id"])
            last = made["id"]
            self.steps.append(made)
        if last:
            self.edges = [
                {**edge, "target": first} if edge["target"] == step["id"] else edge
                for edge in self.edges
            ]
            self._wait(last, step["id"])
        self.steps.append(step)

    def end(self, rinses: Sequence[Deed]) -> None:
        """Append rinses behind all that nothing follows yet."""
        for deed in rinses:
            followed = {edge["source"] for edge in self.edges}
            ends = [step["id"] for step in self.steps if step["id"] not in followed]
            made = self._rinse(deed)
            self.steps.append(made)
            for one in ends:
                self._wait(one, made["id"])

    def placed(self) -> list[dict[str, Any]]:
        """Return the steps, one below the other."""
        return [
            {**step, "position": {"x": _TOP, "y": _TOP + _PITCH * place}}
            for place, step in enumerate(self.steps)
        ]

    def _rinse(self, deed: Deed) -> dict[str, Any]:
        self._counts[deed.added] += 1
        _, way, amount, *_ = deed.what
        is_push = deed.added == PUSH
        params = {
            "gas" if is_push else "source": f"@{way.source}",
            "target": f"@{way.target}",
            "volume": f"{Decimal(amount) / _NL_PER_ML:f} mL",
        }
        if len(deed.pumps) == 1:
            params["pump"] = f"@{deed.pumps[0]}"
        key, kind = f"{deed.added}{self._counts[deed.added]}", "push_gas" if is_push else "transfer"
        return {"id": key, "kind": kind, "params": params, "note": _NOTES[deed.added]}

    def _wait(self, source: str, target: str) -> None:
        self.edges.append(
            {
                "id": f"{source}-{target}",
                "source": source,
                "source_port": "done",
                "target": target,
                "target_port": "start",
            }
        )
