"""Check the sums of a plan, and which of its steps may run at the same time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from labweb.domain.errors import Finding
from labweb.domain.messages.plan_fields import BY_HAND
from labweb.domain.proof.plan_read import ProofPlan, ProofStep
from labweb.domain.proof.plan_state import TOLERANCE, StepRecord

_CLOSE = 1e-6
_Queue = tuple[str | None, str | None]
"""Queue of the recipe, and what runs beside the rest."""

_ROOT: _Queue = (None, None)
_UNHELD = frozenset(("wait", "ask"))
"""Claims that name no vessel: what they are for is what runs when they begin."""


def check_after(steps: Sequence[ProofStep], touched: Sequence[set[str]]) -> list[Finding]:
    """List the steps that do not wait for an earlier one with whose device or vessel they work.

    What names no vessel has its order from its queue.
    """
    findings = []
    waits_for: dict[int, int] = {}
    """Step → the steps that end before it begins, as bits."""

    last: dict[str, int] = {}
    queues = _Queues()
    for step, keys in zip(steps, touched, strict=True):
        known = 0
        for other in step.after:
            known |= waits_for.get(other, 0) | 1 << other
        waits_for[step.id] = known
        for other in (key for key in step.skip_if if not known >> key & 1):
            message = f"step {step.id} does not wait for the reading of step {other}"
            findings.append(Finding("interpret.unordered", message, f"step {step.id}"))
        for key in sorted(keys):
            other = last.get(key, 0)
            if other and not known >> other & 1:
                message = f"step {step.id} uses {key} and does not wait for step {other}"
                context = {"device": key}
                findings.append(Finding("interpret.unordered", message, f"step {step.id}", context))
            last[key] = step.id
        findings += queues.check(step, known)
    return findings


class _Queues:
    """Sees that what names no vessel has its place among the steps of its queue."""

    def __init__(self) -> None:
        self._all: dict[_Queue, int] = {}
        """Queue → its steps so far, as bits."""

        self._unheld: dict[_Queue, int] = {}
        """Queue → those of them that name no vessel."""

    def check(self, step: ProofStep, known: int) -> list[Finding]:
        """List what a step has to wait for, and does not; `known` are the steps it waits for."""
        queue: _Queue = (step.queue, step.beside)
        is_unheld = step.claim.kind in _UNHELD
        before = self._all if is_unheld else self._unheld
        missing = ~known & sum(
            bits
            for other, bits in before.items()
            if other in (queue, _ROOT) or _waits(queue, other)
        )
        for table in (self._all, self._unheld) if is_unheld else (self._all,):
            table[queue] = table.get(queue, 0) | 1 << step.id
        if not missing:
            return []
        other = missing.bit_length() - 1
        what = (
            f"names no vessel to wait for ({step.claim.kind}), and" if is_unheld else "goes on and"
        )
        message = f"step {step.id} {what} does not wait for step {other}, which stands before it"
        return [Finding("interpret.unordered", message, f"step {step.id}")]


def _waits(queue: _Queue, other: _Queue) -> bool:
    """Tell whether what is in no queue waits for another queue: for all but what runs beside."""
    return queue == _ROOT and other[1] is None


def check_totals(plan: ProofPlan, records: Sequence[StepRecord]) -> list[Finding]:
    """List the totals that are not the sums of the steps."""
    totals = plan.totals
    return [
        Finding("interpret.totals", f"totals.{name} is not what the steps sum up to", "totals")
        for name, is_right in (
            ("duration_s", _is_close(totals.duration_s, sum(s.estimate_s for s in plan.steps))),
            ("critical_path_s", _is_close(totals.critical_path_s, _critical_path_s(plan.steps))),
            ("by_hand_count", totals.by_hand_count in (None, _by_hand_count(plan))),
            ("delivered_ul", _delivers(totals.delivered_ul, _delivered(plan, records), 10**9)),
            ("delivered_ug", _delivers(totals.delivered_ug, _added(records), 10**6)),
        )
        if not is_right
    ]


def _is_close(said: float | None, found: float) -> bool:
    return said is None or math.isclose(said, found, rel_tol=_CLOSE, abs_tol=1e-3)


def _critical_path_s(steps: Sequence[ProofStep]) -> float:
    ends: dict[int, float] = {}
    for step in steps:
        begins = max((ends.get(other, 0.0) for other in step.after), default=0.0)
        ends[step.id] = begins + step.estimate_s
    return max(ends.values(), default=0.0)


def _by_hand_count(plan: ProofPlan) -> int:
    actions = (action for step in plan.steps for group in step.groups for action in group)
    return sum(action.device == BY_HAND for action in actions)


def _delivered(plan: ProofPlan, records: Sequence[StepRecord]) -> Iterator[tuple[str, str, int]]:
    """Yield vessel, lot and units of what came out of flasks of reagents, without rinses."""
    flasks = plan.flasks()
    for step, record in zip(plan.steps, records, strict=True):
        for flow in record.flows if step.claim.kind == "transfer" else ():
            if flow.source.key in flasks:
                for lot, amount in flow.liquids.items():
                    yield flow.target.key, lot, amount.most


def _added(records: Sequence[StepRecord]) -> Iterator[tuple[str, str, int]]:
    """Yield vessel, lot and units of the solids that people added."""
    for effect in (effect for record in records for effect in record.effects):
        if effect.name == "add_solid" and isinstance(effect.value, int):
            yield effect.vessels[0], effect.lot, effect.value


def _delivers(
    said: Mapping[str, Mapping[str, float]] | None,
    found: Iterator[tuple[str, str, int]],
    grain: int,
) -> bool:
    if said is None:
        return True
    sums: dict[tuple[str, str], int] = {}
    for vessel, lot, more in found:
        sums[vessel, lot] = sums.get((vessel, lot), 0) + more
    for vessel, lots in said.items():
        for lot, amount in lots.items():
            sums[vessel, lot] = sums.get((vessel, lot), 0) - round(amount * grain)
    return all(abs(difference) <= TOLERANCE for difference in sums.values())
