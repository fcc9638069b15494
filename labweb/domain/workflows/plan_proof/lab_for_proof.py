"""A lab as the proof reads it: its plumbing, and what is in the vessels that a plan uses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import replace
from uuid import UUID

from labweb.domain.crutd.snapshot import ResourceState
from labweb.domain.graph.rig.lab_as_rig import rig_of
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, Contents
from labweb.domain.resources.contents_by_lot import LotId, Phase
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.plan_proof.jobs_for_proof import contents, sized

SYRINGE = "syringe_pump"
"""Kind of a resource that liquid only passes through."""


def plumbing_of(lab: PlannerView, used: Set[UUID]) -> Rig:
    """Return the plumbing of a lab, as far as anything is joined or used."""
    ends = ((one.source, one.target) for one in lab.graph.connections)
    joined = {end.resource_id for pair in ends for end in pair} | used
    known = [one for one in map(lab.tree.by_id.get, joined) if one is not None]
    there = {one.id for one in known}
    tubes = [
        one
        for one in lab.graph.connections
        if {one.source.resource_id, one.target.resource_id} <= there
    ]
    resources = sorted(known, key=lambda one: one.key)
    rig = rig_of(resources, tubes, [device.nodes for device in lab.devices])
    states = {lab.tree.find(node).key: lab.state(node) for node in there}
    elements = (sized(one, states[one.key]) for one in rig.elements)
    return replace(rig, elements=tuple(elements))


def contents_of(lab: PlannerView, used: Set[UUID]) -> dict[str, Contents]:
    """Return what is in the vessels that are used, by their keys, before the first step."""
    return {
        lab.tree.find(node).key: contents(state.contents, solids_of(lab, state))
        for node, state in _vessels(lab, used)
        if state.contents or solids_of(lab, state)
    }


def capacities_of(lab: PlannerView, used: Set[UUID]) -> dict[str, int]:
    """Return how much these vessels hold, in the units of the proof."""
    return {
        lab.tree.find(node).key: state.capacity_nl * UNITS_PER_NL
        for node, state in _vessels(lab, used)
        if state.capacity_nl
    }


def solids_of(lab: PlannerView, state: ResourceState) -> Mapping[LotId, int]:
    """Return the lots of a vessel that are no gas, of those that are counted by mass, in µg."""
    return {lot: ug for lot, ug in state.masses.items() if ug and not is_gas(lab, lot)}


def is_gas(lab: PlannerView, lot: str) -> bool:
    """Tell whether a lot is known to be a gas, which no proof follows."""
    known = None if lab.facts is None else lab.facts.lots.get(LotId(lot))
    return known is not None and known.phase is Phase.GAS


def _vessels(lab: PlannerView, used: Set[UUID]) -> Iterator[tuple[UUID, ResourceState]]:
    for node in sorted(used):
        state = lab.state(node)
        if state is not None and is_vessel(state.kind) and state.kind != SYRINGE:
            yield node, state
