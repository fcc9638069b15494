"""Tubes that say what they hold: full before the first exact volume comes out of a flask."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from labweb.domain.errors import Finding
from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL
from labweb.domain.proof.plan_read import ProofPlan
from labweb.domain.proof.plan_state import StepRecord
from labweb.domain.proof.plumbing import Plumbing

Ends = frozenset[tuple[str, str]]
"""Both ends of a tube: element and port. A tube that is drawn in both directions is one."""


def check_filling(
    plan: ProofPlan, plumbing: Plumbing, records: Sequence[StepRecord]
) -> Iterator[Finding]:
    """Yield a finding for each delivery out of a tube that is not known to be full.

    A plan that sums up what priming takes (`totals.primed_ul`) claims that it primes.
    """
    if plan.totals.primed_ul is None:
        return
    flasks = plan.flasks()
    drawn: dict[tuple[str, Ends], int] = {}
    """What is known to have come out of a flask by each of its tubes."""
    primed: dict[str, int] = {}
    for step, record in zip(plan.steps, records, strict=True):
        is_exact = step.claim.kind == "transfer" and bool(step.claim.volume_ul)
        for flow in record.flows:
            key = flow.source.key
            tubes = _tubes(plumbing, record, key)
            if is_exact and key in flasks:
                yield from _check_full(step.id, key, tubes, drawn)
            if step.claim.kind == "prime":
                for lot, amount in flow.liquids.items():
                    primed[lot] = primed.get(lot, 0) + amount.most
            for ends in tubes if len(tubes) == 1 else ():
                drawn[key, ends] = drawn.get((key, ends), 0) + flow.volume.least
    said = {lot: round(ul * 1000) * UNITS_PER_NL for lot, ul in plan.totals.primed_ul.items()}
    if said != primed:
        message = "totals.primed_ul is not what the steps sum up to"
        yield Finding("interpret.totals", message, "totals")


def _check_full(
    step: int, flask: str, tubes: Mapping[Ends, int], drawn: dict[tuple[str, Ends], int]
) -> Iterator[Finding]:
    """Yield a finding for each tube that less came out of than it holds; tell it once."""
    for ends, held in tubes.items():
        if drawn.get((flask, ends), 0) < held:
            message = f"step {step}: the tube of {flask} is not full before it"
            yield Finding("interpret.not_primed", message, f"step {step}")
            drawn[flask, ends] = held


def _tubes(plumbing: Plumbing, record: StepRecord, flask: str) -> dict[Ends, int]:
    """Return the tubes of a step that end at a flask, and the units that each says it holds."""
    used = set(plumbing.tubes_of(record.ways))
    found: dict[Ends, int] = {}
    for tube in plumbing.tubes:
        if tube.key in used and flask in (tube.source, tube.target):
            ends = frozenset({(tube.source, tube.source_port), (tube.target, tube.target_port)})
            held = (tube.dead_volume_nl or 0) * UNITS_PER_NL
            found[ends] = max(found.get(ends, 0), held)
    return found
