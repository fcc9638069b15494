"""Steps that share something must say which comes first; the order is never guessed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from uuid import UUID

from labweb.domain.crutd.operations import TransferResource, touched_ids
from labweb.domain.errors import Finding
from labweb.domain.workflows.passes.drafted_jobs import DraftStep
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS
from labweb.domain.workflows.workflow_file import Step

MOST_FINDINGS = 20
"""Findings of this sort that are told at once; one more says how many there are besides."""

_MOST_NAMES = 5
"""Steps, or things, that a message names."""

_MATTER = frozenset({"sample", "resource"})
"""Parameters besides the vessels of a step that name matter."""


@dataclass(kw_only=True)
class _Use:
    """Who uses one thing; a bit for each step, in the order in which they are planned."""

    itself: int = 0
    """Steps that use the thing itself."""

    as_place: int = 0
    """Those of them for which it is only the place that something leaves or reaches."""

    within: int = 0
    """Steps that use something that stands in or on it, and not the thing itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Group:
    """Steps that share things without an order."""

    steps: int
    things: list[UUID] = field(default_factory=list)


def check_order(
    drafts: Sequence[DraftStep],
    earlier: Mapping[str, frozenset[str]],
    view: PlannerView,
    drawn: Sequence[str],
) -> list[Finding]:
    """List the groups of steps that use the same thing with no order among them.

    Whoever uses a thing uses what stands in or on it: an order is needed between carrying a
    plate and filling one of its wells, and none between filling two of them. A place that a
    thing is carried to or from is used alone, without what stands there.

    Args:
        drafts: The steps in the order in which they are planned.
        earlier: By step, every step that is done before it starts.
        view: The lab.
        drawn: Ids of all steps in the order of the document, from which people count them.

    Returns:
        One finding for each thing, or for several that the same steps share; its subject is the
        second of the steps, and `context["steps"]` names all. At most `MOST_FINDINGS` and one
        that counts the others. Two steps that share nothing give none.
    """
    groups = _groups(drafts, earlier, view)
    ids = [draft.step.id for draft in drafts]
    called = {step_id: f"{place} ({step_id})" for place, step_id in enumerate(drawn, start=1)}
    findings = [_finding(group, ids, called, view) for group in groups[:MOST_FINDINGS]]
    rest = groups[MOST_FINDINGS:]
    if rest:
        message = (
            f"{len(rest)} more groups of steps share something, and nothing says in which order "
            "they run: connect the steps above first, then check again"
        )
        context = {"field": "edges", "more": len(rest)}
        findings.append(
            Finding("protocol.unordered", message, ids[list(_bits(rest[0].steps))[1]], context)
        )
    return findings


def _groups(
    drafts: Sequence[DraftStep], earlier: Mapping[str, frozenset[str]], view: PlannerView
) -> list[_Group]:
    """Return the steps without an order by what they share, the largest groups first."""
    ordered = _ordered([draft.step.id for draft in drafts], earlier)
    found: list[_Group] = []
    loose = [
        (steps, thing)
        for thing, use in _uses(drafts, view).items()
        if (steps := _loose(use, ordered))
    ]
    for steps, thing in sorted(loose, key=lambda one: (-one[0].bit_count(), one[0], one[1])):
        wider = next((group for group in found if group.steps & steps == steps), None)
        if wider is None:
            found.append(_Group(steps=steps, things=[thing]))
        elif wider.steps == steps:
            wider.things.append(thing)
    return found


def _uses(drafts: Sequence[DraftStep], view: PlannerView) -> dict[UUID, _Use]:
    uses: dict[UUID, _Use] = {}
    touched = [_touched(draft) for draft in drafts]
    for place, ids in enumerate(touched):
        for thing in ids:
            uses.setdefault(thing, _Use()).itself |= 1 << place
        for thing in _places_of(drafts[place]):
            uses.setdefault(thing, _Use()).as_place |= 1 << place
    for place, ids in enumerate(touched):
        known = [thing for thing in ids if thing in view.tree.by_id]
        above = {one.id for thing in known for one in view.tree.ancestors(thing)}
        for thing in (above & uses.keys()) - ids:
            uses[thing].within |= 1 << place
    return uses


def _ordered(ids: Sequence[str], earlier: Mapping[str, frozenset[str]]) -> list[int]:
    """Return, for each step, the bits of the steps that come surely before or after it."""
    place_of = {step_id: place for place, step_id in enumerate(ids)}
    ordered = [0] * len(ids)
    for place, step_id in enumerate(ids):
        for before in earlier[step_id]:
            ordered[place] |= 1 << place_of[before]
            ordered[place_of[before]] |= 1 << place
    return ordered


def _loose(use: _Use, ordered: Sequence[int]) -> int:
    """Return the bits of the users of a thing that have no order with another of its users."""
    loose = 0
    for place in _bits(use.itself):
        own = 1 << place
        users = use.itself if use.as_place & own else use.itself | use.within
        others = users & ~(ordered[place] | own)
        loose |= others | own if others else 0
    return loose


def _bits(bits: int) -> Iterator[int]:
    while bits:
        lowest = bits & -bits
        yield lowest.bit_length() - 1
        bits ^= lowest


def _finding(
    group: _Group, ids: Sequence[str], called: Mapping[str, str], view: PlannerView
) -> Finding:
    steps = [ids[place] for place in _bits(group.steps)]
    names = sorted({view.names.get(str(thing), str(thing)) for thing in group.things})
    shared, those = _listed(names), [called[step_id] for step_id in steps]
    if len(steps) == 2:
        message = (
            f"steps {those[0]} and {those[1]} both use {shared}: "
            "draw an edge to say which comes first"
        )
    else:
        message = (
            f"{len(steps)} steps use {shared}, and nothing says in which order: steps "
            f"{_listed(those)}; draw edges to say which comes first"
        )
    context = {"field": "edges", "other": steps[0], "steps": steps, "shared": names}
    return Finding("protocol.unordered", message, steps[1], context)


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def _touched(draft: DraftStep) -> frozenset[UUID]:
    ids = _named(draft.step)
    for job in draft.jobs:
        # What only one of several devices would touch is free for another step.
        ways = [one.locks.union(touched_ids(one.operation)) for one in job.choices or (job,)]
        ids |= frozenset.intersection(*ways)
    if draft.whole is not None:
        ids |= {draft.whole.source_id, draft.whole.target_id}
    return frozenset(ids)


def _places_of(draft: DraftStep) -> frozenset[UUID]:
    moves = [job.operation for job in draft.jobs if isinstance(job.operation, TransferResource)]
    return frozenset(place for move in moves for place in (move.from_id, move.to_id))


def _named(step: Step) -> set[UUID]:
    """Return the matter that a step names, also one that cannot be planned yet."""
    return {
        UUID(value)
        for parameter in STEP_KINDS[step.kind].parameters
        if parameter.is_vessel or parameter.name in _MATTER
        if isinstance(value := step.params.get(parameter.name), str) and not value.startswith("@")
    }
