"""Which steps wait for which, and how long the longest chain of them takes."""

from __future__ import annotations

from collections.abc import Sequence

from labweb.domain.recipes.on_rig.making import BESIDE, StepDraft
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace

MOST_S = 1e9
"""No plan takes longer than 31 years."""


def earlier_steps(steps: Sequence[StepDraft]) -> list[list[int]]:
    """Return, for each step, the places of those that must have ended before it begins.

    Steps of one queue follow each other. A step of the root queue waits for all queues, and they
    for it; only what runs beside (Async) goes on. No two steps hold one vessel or device at once.
    """
    barrier: int | None = None
    last: dict[str, int] = {}
    holder: dict[str, int] = {}
    found = []
    for place, step in enumerate(steps):
        after: set[int] = {last[lane] for lane in step.waits_for if lane in last}
        if step.lane:
            after |= {last[step.lane]} if step.lane in last else set()
            after |= set() if barrier is None else {barrier}
        else:
            after |= {end for lane, end in last.items() if not lane.startswith(BESIDE)}
            barrier = place
        after |= {holder[name] for name in step.resources if name in holder} | {*step.skip_if}
        found.append(sorted(after))
        last[step.lane] = place
        holder |= dict.fromkeys(step.resources, place)
    return found


def critical_path_s(steps: Sequence[StepDraft], earlier: Sequence[Sequence[int]]) -> float:
    """Return how long the plan takes when every step begins as soon as it may."""
    ends: list[float] = []
    for step, after in zip(steps, earlier, strict=True):
        ends.append(max((ends[place] for place in after), default=0.0) + step.estimate_s)
    return round(max(ends, default=0.0), 3)


def check_duration(steps: Sequence[StepDraft], told: Findings) -> None:
    """Refuse what would take longer than anybody waits, by the step that takes the longest."""
    lasts_s = sum(step.estimate_s for step in steps)
    if lasts_s <= MOST_S:
        return
    longest = max(steps, key=lambda step: step.estimate_s)
    message = (
        f"the plan would take {lasts_s:.3g} s, and may take {MOST_S:.3g} s; the longest step is "
        f"{longest.of['operation']} with {longest.estimate_s:.3g} s"
    )
    place = FilePlace(line=longest.of.get("line", 0), column=longest.of.get("column", 0))
    told.tell("unit.too_large", message, place)
