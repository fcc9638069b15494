"""Which syringes pass liquid on from one to the next, where no single pump reaches both ends.

```text
flask ─▶ valve 1 ─▶ syringe 1 ─▶ valve 1 ═▶ valve 2 ─▶ syringe 2 ─▶ valve 2 ─▶ reactor
```

Between two syringes there is no vessel: one plunger pushes while the next one draws.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import pairwise
from uuid import UUID

import msgspec

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.errors import Finding, NoRouteError
from labweb.domain.graph.ports_and_connections import Connection, PhysicalGraph, PortRef
from labweb.domain.graph.routing import Route
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, MassCheck
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.liquids.pump_choice import (
    Leg,
    Pumping,
    check_share,
    choose_pump,
    find_way,
    make_leg,
    pump_nodes,
)
from labweb.domain.workflows.passes.liquids.stroke_splitting import split_move
from labweb.domain.workflows.passes.liquids.strokes import Strokes, dead_volume_notes, make_strokes
from labweb.domain.workflows.workflow_file import Step


@dataclass(frozen=True, slots=True, kw_only=True)
class SyringeLine:
    """Syringes in the order of flow, with the ways into, between and out of them."""

    pumps: tuple[tuple[AdmittedDevice, UUID], ...]
    legs: tuple[Leg, ...]
    """One more than there are syringes."""

    @property
    def pump_ids(self) -> tuple[UUID, ...]:
        """Return the syringes in the order of flow."""
        return tuple(node for _, node in self.pumps)

    @property
    def notes(self) -> tuple[str, ...]:
        """Say which tubes on the way have a dead volume that nobody stated."""
        return dead_volume_notes(*self.legs)


@dataclass(frozen=True, slots=True, kw_only=True)
class Passes:
    """Makes the jobs of one step along a chain, stroke by stroke; one that is refused is None."""

    chain: SyringeLine
    strokes: tuple[Strokes, ...]

    @property
    def stroke_nl(self) -> int:
        """Return the largest volume that every syringe of the chain takes at once."""
        return min(one.stroke_nl for one in self.strokes)

    def move_all(self, whole: TransferLiquid) -> list[DraftJob | None]:
        """Move a whole from the source to the target, stroke by stroke."""
        strokes = list(split_move(whole, self.stroke_nl))
        jobs: list[DraftJob | None] = []
        for place, part in enumerate(strokes, start=1):
            text = f", stroke {place} of {len(strokes)}" if len(strokes) > 1 else ""
            jobs += self.move(part, text)
            if None in jobs:
                break
        return jobs

    def move(self, part: TransferLiquid, text: str = "") -> list[DraftJob | None]:
        """Move one stroke from the source through all syringes to the target."""
        stops = [part.source_id, *self.chain.pump_ids, part.target_id]
        solids, amount_nl = part.carries_ug, part.amount_nl
        hops = [
            TransferLiquid(source_id=start, target_id=end, amount_nl=amount_nl, carries_ug=solids)
            for start, end in pairwise(stops)
        ]
        # What is stated of lots, and of what stays, holds of what leaves the source.
        hops[0] = msgspec.structs.replace(part, target_id=stops[1])
        legs = self.chain.legs
        jobs = self.strokes[0].draw(hops[0], legs[0], text)
        for place, (giver, receiver) in enumerate(pairwise(self.strokes), start=1):
            jobs += giver.pass_on(hops[place], legs[place], receiver, text)
        return jobs + self.strokes[-1].push(hops[-1], legs[-1], text)


def make_passes(
    step: Step,
    drafting: Drafting,
    chain: SyringeLine,
    mass_check: MassCheck | None = None,
    *,
    is_gas: bool = False,
) -> Passes | None:
    """Find volumes and rate of a step; note what is wrong and return None.

    All syringes of a chain move at the rate of the slowest.
    """
    last = chain.pumps[-1]
    made = [  # only what leaves the last syringe arrives on a balance
        make_strokes(step, drafting, *one, mass_check if one == last else None, is_gas=is_gas)
        for one in chain.pumps
    ]
    found = [one for one in made if one is not None]
    if len(found) < len(made):
        return None
    rate_ul_s = min(one.rate_ul_s for one in found)
    alike = tuple(replace(one, rate_ul_s=rate_ul_s) for one in found)
    return Passes(chain=chain, strokes=alike)


def choose_way(step: Step, drafting: Drafting, whole: TransferLiquid) -> SyringeLine | None:
    """Find the pump of a step that moves liquid, or the chain of them; note why there is none.

    A step that names its pump is done by that one alone.
    """
    wanted = None
    if "pump" in step.params:
        wanted = drafting.view.find_device(UUID(step.params["pump"]))
        if wanted is None:
            message = "no device of this lab drives the pump that is asked for"
            drafting.refuse(step, "plan.no_device", message, "params.pump")
            return None
    through = UUID(step.params["through"]) if "through" in step.params else None
    source, target = whole.source_id, whole.target_id
    view = _by_ports(step, drafting, whole)
    if view is None:
        return None
    unfit: list[Finding] = []

    def check(device: AdmittedDevice, node: UUID) -> list[Finding]:
        found = check_share(step, view, device, node, whole.amount_nl)
        unfit.extend(found)
        return found

    answer = choose_pump(
        view,
        source,
        target,
        whole.amount_nl,
        wanted,
        through=through,
        check=lambda way: check(way.device, way.pump_id),
    )
    if isinstance(answer, Pumping):
        return SyringeLine(pumps=((answer.device, answer.pump_id),), legs=(answer.into, answer.out))
    if wanted is None and not unfit:
        chain = find_chain(view, source, target, through)
        if chain is not None and all(not check(*pump) for pump in chain.pumps):
            return chain
    for finding in unfit:
        drafting.refuse(step, finding.code, finding.message, "params.accuracy")
    if not unfit:
        at = "params.target" if wanted is None else "params.pump"
        drafting.refuse(step, answer.code, answer.message, at, **answer.context)
    return None


def _by_ports(step: Step, drafting: Drafting, whole: TransferLiquid) -> PlannerView | None:
    """Return the lab with the tubes alone that a step lets liquid go by; None: that is refused."""
    view = drafting.view
    for name, vessel in (("source_port", whole.source_id), ("target_port", whole.target_id)):
        wanted = step.params.get(name)
        if wanted is None:
            continue
        tubes = view.graph.liquid.by_resource.get(vessel, ())
        there = {end.port for tube in tubes for end in _ends_at(tube, vessel)}
        if wanted not in there:
            told = f"they are at {', '.join(sorted(there))}" if there else "it has none"
            message = f"no tube for liquid is at port {wanted!r} of {drafting.name(vessel)}: {told}"
            drafting.refuse(step, "plan.unknown_port", message, f"params.{name}")
            return None
        left = tuple(
            tube
            for tube in view.graph.connections
            if all(end.port == wanted for end in _ends_at(tube, vessel))
        )
        view = replace(view, graph=PhysicalGraph(left))
    return view


def _ends_at(tube: Connection, vessel: UUID) -> list[PortRef]:
    return [end for end in (tube.source, tube.target) if end.resource_id == vessel]


def find_chain(
    view: PlannerView, source: UUID, target: UUID, through: UUID | None
) -> SyringeLine | None:
    """Find the chain with the fewest syringes, and of those the one that wastes least.

    Two syringes that move together are driven by one host, which alone can start both at the
    same moment. A cartridge lies on one of the ways: it is passed once. Ties go to the devices
    whose keys sort first.
    """
    pumps = pump_nodes(view.devices_by_key, view)
    queue: list[_Way] = []
    for place, (device, node) in enumerate(pumps):
        for passes, into in _ways(view, source, node, through):
            heappush(queue, (1, into.dead_volume_nl, (device.key,), (place,), (passes,)))
    seen: set[tuple[int, bool]] = set()
    while queue:
        way = heappop(queue)
        places, passed = way[3:]
        if places[-1] == len(pumps):
            chosen = [pumps[place] for place in places[:-1]]
            found = _render(view, (source, target), chosen, through, passed)
            if found is not None:
                return found
        elif (places[-1], any(passed)) not in seen:
            seen.add((places[-1], any(passed)))
            for further in _further(view, pumps, way, target, through):
                heappush(queue, further)
    return None


_Way = tuple[int, int, tuple[str, ...], tuple[int, ...], tuple[bool, ...]]
"""Syringes so far, nL wasted, their keys, their places (the number of all: it has arrived), and
for each way between them whether it goes through the cartridge."""


def _further(
    view: PlannerView,
    pumps: list[tuple[AdmittedDevice, UUID]],
    way: _Way,
    target: UUID,
    through: UUID | None,
) -> Iterator[_Way]:
    """Yield a way with one more leg: into the target, or into a syringe that is not on it yet."""
    count, dead_nl, keys, places, passed = way
    is_past = any(passed)
    for passes, out in _ways(view, pumps[places[-1]][1], target, None if is_past else through):
        if is_past or passes or through is None:
            wasted_nl = dead_nl + out.dead_volume_nl
            yield count, wasted_nl, keys, (*places, len(pumps)), (*passed, passes)
    for place, passes, between in _onward(view, pumps, places[-1], None if is_past else through):
        if place not in places:
            wasted_nl = dead_nl + between.dead_volume_nl
            more = (*keys, pumps[place][0].key)
            yield count + 1, wasted_nl, more, (*places, place), (*passed, passes)


def _onward(
    view: PlannerView, pumps: list[tuple[AdmittedDevice, UUID]], last: int, through: UUID | None
) -> Iterator[tuple[int, bool, Route]]:
    device, node = pumps[last]
    for place, (other, beyond) in enumerate(pumps):
        if place != last and other.host_id == device.host_id:
            for passes, between in _ways(view, node, beyond, through):
                yield place, passes, between


def _ways(
    view: PlannerView, source: UUID, target: UUID, through: UUID | None
) -> Iterator[tuple[bool, Route]]:
    """Yield the way between two ends, and the one through a cartridge, as far as there are."""
    for passes in (None, through) if through is not None else (None,):
        with suppress(NoRouteError):
            yield passes is not None, find_way(view, source, target, passes)


def _render(
    view: PlannerView,
    ends: tuple[UUID, UUID],
    pumps: list[tuple[AdmittedDevice, UUID]],
    through: UUID | None,
    passed: tuple[bool, ...],
) -> SyringeLine | None:
    """Return the chain with its valves; None: one of them cannot be turned as it has to be."""
    devices = {node: device for device, node in pumps}
    stops = [ends[0], *(node for _, node in pumps), ends[1]]
    legs = []
    for (start, end), passes in zip(pairwise(stops), passed, strict=True):
        route = find_way(view, start, end, through if passes else None)
        leg = make_leg(view, route, devices)
        if not isinstance(leg, Leg):
            return None
        legs.append(leg)
    return SyringeLine(pumps=tuple(pumps), legs=tuple(legs))
