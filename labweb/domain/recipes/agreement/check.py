"""The deeds of a proved plan and of a workflow, compared one by one.

```text
recipe ─▶ plan ─▶ proved ─▶ deeds ─┐
       └▶ workflow ───────▶ deeds ─┴▶ findings
```
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from itertools import zip_longest
from typing import Any

from labweb.domain.errors import Finding, ProtocolError
from labweb.domain.recipes.agreement.deeds import Deed
from labweb.domain.recipes.agreement.meant import deeds_of_workflow
from labweb.domain.recipes.agreement.proved import deeds_of_plan
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS, called
from labweb.domain.workflows.workflow_edges import check_edges, find_earlier

_MOVES = frozenset(kind for kind, one in STEP_KINDS.items() if one.parameter("pump") is not None)
"""Steps whose liquid, or gas, goes over syringes and valves."""

_RATE_RATIO = 1e-3
"""How near two rates are to be the same, of the larger."""


def check_agreement(
    plan: Mapping[str, Any], document: Mapping[str, Any], pumps: Collection[str] | None = None
) -> list[Finding]:
    """List where a workflow would not do what a proved plan does; empty: they agree.

    Compared are, in their order: which vessel gives how much to which, by which cartridges and
    how fast; layers, evaporations, evacuations and waits; and how the vessels are stirred and
    heated meanwhile. The edges of the workflow have to order its steps as they are listed, where
    two have a vessel in common or one of them is a wait, which goes for all vessels.

    Args:
        plan: As `docs/plan.md` says it, proved.
        document: The workflow of the same recipe, its vessels as `@key` of the same lab.
        pumps: Those of the rig. Where lines are rinsed or primed, or some lots must not meet, it
            counts which syringe liquid goes through; a step that does not say it goes through
            the only one. None: not known.
    """
    proved, meant = deeds_of_plan(plan), list(deeds_of_workflow(document))
    is_apart = bool(plan.get("keeps_apart"))
    has_one = pumps is not None and len(pumps) == 1
    is_free = has_one or not (is_apart or any(deed.added for deed in proved))
    whats = [deed.what for deed in proved], [deed.what for deed in meant]
    matcher = SequenceMatcher(None, *whats, autojunk=False)
    findings: list[Finding] = []
    for kind, start, end, other, other_end in matcher.get_opcodes():
        pairs = proved[start:end], meant[other:other_end]
        if kind == "equal":
            findings += [*_rates(*pairs), *_syringes(*pairs, is_free=is_free)]
        else:
            findings += _differences(*pairs)
    return [*findings, *_unordered(document, is_apart=is_apart)]


def check_same(
    plan: Mapping[str, Any], document: Mapping[str, Any], pumps: Collection[str] | None = None
) -> None:
    """Refuse a workflow that would not do what a proved plan does.

    Raises:
        ProtocolError: `recipe.differs`; `findings` list each deed.
    """
    findings = check_agreement(plan, document, pumps)
    if findings:
        message = (
            "the workflow would not do what the plan is proved to do, so it is none; "
            f"{len(findings)} of its deeds are others"
        )
        raise ProtocolError(message, code="recipe.differs", findings=findings)


def _rates(proved: Sequence[Deed], meant: Sequence[Deed]) -> Iterator[Finding]:
    """Compare how fast the same liquid is pushed, where the workflow says it."""
    for one, other in zip(proved, meant, strict=True):
        for wanted in other.rates_ul_s:
            if any(abs(rate - wanted) > _RATE_RATIO * max(rate, wanted) for rate in one.rates_ul_s):
                told = ", ".join(f"{rate:g}" for rate in one.rates_ul_s)
                message = f"{one.text}: the plan pushes at {told} µL/s, the workflow at {wanted:g}"
                yield _finding(message, one, other)


def _syringes(proved: Sequence[Deed], meant: Sequence[Deed], *, is_free: bool) -> Iterator[Finding]:
    """Compare whose syringes the same liquid goes through, where that counts."""
    for one, other in zip(proved, meant, strict=True):
        is_open = not other.pumps and (is_free or not one.pumps)
        if not is_open and one.pumps != other.pumps:
            said = ", ".join(other.pumps) or "any that reaches"
            message = f"{one.text}: the plan takes {', '.join(one.pumps)}, the workflow {said}"
            yield _finding(message, one, other)


def _differences(proved: Sequence[Deed], meant: Sequence[Deed]) -> Iterator[Finding]:
    for one, other in zip_longest(proved, meant):
        known = "nothing of it" if one is None else one.text
        said = "nothing of it" if other is None else other.text
        yield _finding(f"proved is: {known}; the workflow would do: {said}", one, other)


def _unordered(document: Mapping[str, Any], *, is_apart: bool) -> Iterator[Finding]:
    """Find the steps that do not wait for one before them with which they share a vessel.

    Where some lots must not meet, all that moves liquid shares the syringes and valves: what is
    left in them was proved for one order.
    """
    steps = document["steps"]
    earlier = find_earlier([step["id"] for step in steps], check_edges(document["edges"], steps)[0])
    for place, later in enumerate(steps):
        for step in steps[:place]:
            is_shared = _share(step, later) or (is_apart and _both_move(step, later))
            if step["id"] not in earlier[later["id"]] and is_shared:
                text = f"{called(later, {})} has to follow {called(step, {})}, and no edges say so"
                context = {"step": later["id"], "before": step["id"]}
                yield Finding("recipe.differs", text, later["id"], context)


def _both_move(*steps: Mapping[str, Any]) -> bool:
    return all(step["kind"] in _MOVES for step in steps)


def _share(*steps: Mapping[str, Any]) -> bool:
    one, other = (
        {v for v in step["params"].values() if isinstance(v, str) and v.startswith("@")}
        for step in steps
    )
    return any(step["kind"] == "wait" for step in steps) or not one.isdisjoint(other)


def _finding(message: str, *deeds: Deed | None) -> Finding:
    context = {name: v for deed in deeds if deed is not None for name, v in deed.place.items()}
    if "line" in context:
        message = f"line {context['line']}: {message}"
    return Finding("recipe.differs", message, str(context.get("step", "")), context)
