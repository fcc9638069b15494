"""Search for the fewest changes of a rig with which a recipe compiles and is proved."""

from __future__ import annotations

import hashlib
import heapq
from dataclasses import dataclass, replace
from typing import Any

from labweb.domain.clock_and_ids import Clock
from labweb.domain.errors import Finding, InfeasibleError, LabError, ProtocolError
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.proof.prove_plan import find_unproved
from labweb.domain.recipes.advise.changes_for_finding import cures
from labweb.domain.recipes.advise.draw_chemputer_graph import Drawing
from labweb.domain.recipes.advise.drawable_formats import draw_rig
from labweb.domain.recipes.advise.rig_changes import DrawableChange
from labweb.domain.recipes.recipe_to_plan import CompileWish, compile_recipe
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe

MOST_TRIALS = 100
"""Most rigs that are drawn and compiled for one advice."""

MOST_S = 10.0
"""Longest that somebody waits for one: no rig is tried after it."""

Changes = tuple[DrawableChange, ...]


@dataclass(frozen=True, slots=True)
class Advice:
    """What to change, and the graph in which it is changed."""

    changes: tuple[dict[str, Any], ...]
    """Each `{"change", "text", "adds"}`, in the order of doing."""

    graph: bytes
    """The corrected graph, as a file."""

    plan: dict[str, Any]
    """The plan of the recipe on it, which the verifier has proved."""

    def to_json(self) -> dict[str, Any]:
        """Return it for an answer."""
        digest = hashlib.sha256(self.graph).hexdigest()
        return {"ok": True, "changes": list(self.changes), "graph_sha256": digest}


def advise(
    recipe: Recipe, rig: Rig, wish: CompileWish | None = None, clock: Clock | None = None
) -> Advice | list[Finding]:
    """Find the changes that make a recipe fit a rig, with the fewest new devices.

    Every trial is compiled anew. Where a finding has one cure, every advice holds it; where it
    has several, all are followed, the cheapest first. At last each change is left out once, and
    stays out when the plan is proved without it.

    Args:
        recipe: The recipe.
        rig: The rig, of which a copy is changed.
        wish: What is asked beside the recipe.
        clock: Ends the search after `MOST_S`; None: the count of trials alone does.

    Returns:
        The advice, of which the plan is proved; or why there is none.

    Effect:
        None. Nothing is changed but a copy.
    """
    if draw_rig(rig) is None:
        message = "nothing in this graph is joined to anything: no advice is drawn into it"
        return [Finding("plan.no_advice", message)]
    return _Search(recipe, rig, wish or CompileWish(), clock).run()


class _Search:
    def __init__(self, recipe: Recipe, rig: Rig, wish: CompileWish, clock: Clock | None) -> None:
        self._recipe, self._rig, self._wish = recipe, rig, wish
        self._clock = clock
        self._begun_s = 0.0 if clock is None else clock.monotonic_s()
        reagents = recipe.synthesis.reagents if len(recipe.syntheses) == 1 else ()
        self._wanted = frozenset(n for r in reagents for n in (r.id, r.name)) | frozenset(
            wish.bind.values()
        )
        self._stuck: list[Finding] = []
        self._trials = 0

    def run(self) -> Advice | list[Finding]:
        heap: list[tuple[int, int, Changes]] = [(0, 0, ())]
        count, seen = 0, set[Changes]()
        while heap and not self._is_over():
            _, _, changes = heapq.heappop(heap)
            drawing = self._drawn(changes)
            if drawing is None:
                continue
            tried = self._try(drawing)
            if isinstance(tried, dict):
                return self._shorter(changes, drawing, tried)
            for more in self._more(tried, changes):
                longer = _merged(changes, more)
                following = self._drawn(longer)
                if following is None:
                    self._stuck = self._stuck or [_no_advice(finding) for finding in tried]
                elif longer not in seen:
                    seen.add(longer)
                    count += 1
                    heapq.heappush(heap, (following.cost, count, longer))
        if heap or not self._stuck:
            message = f"{self._trials} rigs were tried, and the recipe fits none"
            message += ": there was no time for others" if heap else ""
            return [*self._stuck, Finding("plan.no_advice", message)]
        return self._stuck

    def _is_over(self) -> bool:
        late = self._clock is not None and self._clock.monotonic_s() > self._begun_s + MOST_S
        return late or self._trials >= MOST_TRIALS

    def _drawn(self, changes: Changes) -> Drawing | None:
        drawing = draw_rig(self._rig, self._wanted)
        if drawing is None or not all(change.draw(drawing) for change in changes):
            return None
        return drawing

    def _try(self, drawing: Drawing) -> dict[str, Any] | list[Finding]:
        """Compile on a drawing: the plan, or what is still missing."""
        self._trials += 1
        try:
            rig = drawing.rig()
            plan = compile_recipe(self._recipe, rig, self._wish)
        except (InfeasibleError, ProtocolError) as error:
            return list(error.findings)
        except LabError as error:
            return [Finding(error.code, error.message)]
        head = {"recipe": {"id": "recipe", "sha256": "0" * 64}, "graph_sha256": "0" * 64}
        unproved = find_unproved(plan | head, rig)
        return unproved or plan

    def _more(self, findings: list[Finding], before: Changes) -> list[Changes]:
        """Return what to draw next: all that have one cure, with each of the first that has more.

        A finding without a cure may follow from another. Where none has one, they are kept to be
        told. Nothing is advised on what is stated wrongly: a larger vessel would hide the mistake.
        """
        wrong = [_no_advice(one) for one in findings if one.code == "plan.stated_overfull"]
        if wrong:
            self._stuck = wrong
            return []
        forced: list[DrawableChange] = []
        several: list[DrawableChange] = []
        stuck = []
        for finding in findings:
            found = [one for one in cures(finding) if _merged(before, (one,)) != before]
            if not found:
                stuck.append(finding)
            elif len(found) == 1:
                forced += found
            elif not several:
                several = found
        forced = list(_merged((), tuple(forced)))
        if not forced and not several:
            self._stuck = self._stuck or [_no_advice(finding) for finding in stuck]
            return []
        return [(*forced, one) for one in several] or [tuple(forced)]

    def _shorter(self, changes: Changes, drawing: Drawing, plan: dict[str, Any]) -> Advice:
        """Leave out every change without which the plan is proved all the same.

        What a recipe names is never tried: without its flask or vessel it does not compile.
        """
        for change in reversed([one for one in changes if not one.is_named]):
            fewer = tuple(one for one in changes if one != change)
            less = self._drawn(fewer)
            if less is None or less.cost > drawing.cost or len(less.done) >= len(drawing.done):
                continue
            if self._clock is not None and self._is_over():
                break
            tried = self._try(less)
            if isinstance(tried, dict):
                changes, drawing, plan = fewer, less, tried
        # Valves come first: what is joined to them follows.
        ordered = sorted(drawing.done, key=lambda one: one.kind != "add_valve")
        done = tuple(
            {"change": one.kind, "text": one.text(), "adds": [key for key in one.adds if key]}
            for one in ordered
        )
        return Advice(done, drawing.bytes(), plan)


def _merged(before: Changes, more: Changes) -> Changes:
    """Join changes: each once, one size of a vessel, one thermostat for all its temperatures.

    What no waste takes goes into one new one; each liquid that none may get beside what is in it,
    into another.
    """
    found: dict[tuple[str, str, object], DrawableChange] = {}
    for change in (*before, *more):
        is_shared = change.kind in ("enlarge", "attach_thermostat", "add_waste")
        key = (change.kind, change.subject, None if is_shared else change.value)
        other = found.get(key)
        value = change.value
        if other is not None and change.degrees:
            value = tuple(sorted({*change.degrees, *other.degrees}))
        elif other is not None and change.kind == "enlarge":
            value = max(change.amount, other.amount)
        elif other is not None and change.kind == "add_waste":
            value = ",".join(sorted({*change.streams, *other.streams}))
        found[key] = replace(change, value=value)
    return tuple(found.values())


def _no_advice(finding: Finding) -> Finding:
    message = f"no change of the plumbing cures {finding.code}: {finding.message}"
    return Finding("plan.no_advice", message, finding.subject, finding.context)
