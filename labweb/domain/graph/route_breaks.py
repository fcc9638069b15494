"""Why no chain leads from one vessel to another: the breaks of the way that has fewest."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import Element, ElementRole, Tube
from labweb.domain.graph.flow_obstacles import Flaw, find_flaws, find_link_flaw, find_no_pump
from labweb.domain.graph.port_network import Arc, Network
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.syringe_chain import WantedChain

_LISTED = 8


@dataclass(slots=True)
class _Step:
    element: int
    port: str
    arc: Arc
    parent: _Step | None
    pumped: bool
    flaws: tuple[Flaw, ...]


def find_breaks(
    network: Network, wanted: WantedChain, defects: tuple[Finding, ...]
) -> list[Finding]:
    """Say which element liquid reaches, and what is missing after it.

    Every way is looked at as if nothing stood in it, and the one with the fewest breaks is
    told, each of its breaks a finding, in order of flow. When no tube of any sort joins the
    two, what each of them is joined to is told instead.
    """
    elements = network.elements
    source, target = elements[wanted.source], elements[wanted.target]
    found = _dead_ends(network, wanted)
    if found:
        return [*found, *_relevant(defects, source.key, target.key)]
    last = _least_broken(network, wanted) if _are_joined(network, wanted) else None
    if last is None:
        return [_apart(network, wanted), *_relevant(defects, source.key, target.key)]
    steps = [last]
    while steps[-1].parent is not None:
        steps.append(steps[-1].parent)
    steps.reverse()
    findings: list[Finding] = []
    way = [source.key, *(elements[step.element].key for step in steps)]
    for each in (flaw for step in steps for flaw in step.flaws):
        context = {"source": source.key, "target": target.key, "reached": each.element, "way": way}
        finding = Finding(each.code, each.tell(), each.element, context)
        if finding not in findings:  # a way out and back again meets the same break twice
            findings.append(finding)
    if not findings:
        message = (
            f"no way from {source.key} to {target.key} fits what is asked: "
            f"the nearest is {' → '.join(way)}"
        )
        findings.append(Finding("plan.no_route", message, source.key, {"way": way}))
    return findings + _relevant(defects, *way)


def _relevant(defects: tuple[Finding, ...], *keys: str) -> list[Finding]:
    on_way = [d for d in defects if d.context["element"] in keys]
    return (on_way or list(defects))[:_LISTED]


def _dead_ends(network: Network, wanted: WantedChain) -> list[Finding]:
    """Return findings for an end that no tube leads from, or to."""
    source, target = network.elements[wanted.source], network.elements[wanted.target]
    leaving = {arc.own_port for arc in network.arcs[wanted.source]}
    entering = {arc.far_port for arcs in network.arcs for arc in arcs if arc.far == wanted.target}
    found = []
    for element, ports, port, verb in (
        (source, leaving, wanted.source_port, "leads liquid out of"),
        (target, entering, wanted.target_port, "leads liquid into"),
    ):
        if not ports:
            found.append(_no_tube(network, element, verb))
        elif port is not None and port not in ports:
            message = (
                f"no tube {verb} {element.key} at port {port!r}; "
                f"there is one at {', '.join(sorted(ports)) or 'a port without a name'}"
            )
            context = {"port": port, "ports": sorted(ports)}
            found.append(Finding("plan.unknown_port", message, element.key, context))
    return found


def _no_tube(network: Network, element: Element, verb: str) -> Finding:
    joined = [t for t in network.tubes if element.key in (t.source, t.target)]
    if not joined:
        message = f"no tube {verb} {element.key}: nothing is joined to it"
    else:
        what = ", ".join(sorted({_describe(t, element.key) for t in joined})[:_LISTED])
        message = f"no tube {verb} {element.key}: it is joined only by {what}"
    return Finding("plan.no_tube", message, element.key, {"links": [t.key for t in joined]})


def _describe(tube: Tube, own: str) -> str:
    far = tube.target if tube.source == own else tube.source
    if tube.medium is not Medium.LIQUID:
        return f"a link with {far} that carries no liquid ({tube.medium.value})"
    return f"a tube {'to' if tube.source == own else 'from'} {far}, which conducts one way"


def _least_broken(network: Network, wanted: WantedChain) -> _Step | None:
    around = _all_arcs(network)
    heap: list[tuple[int, int, bool, _Step]] = []
    found: Iterable[tuple[int, bool, _Step]] = _set_out(network, wanted, around[wanted.source])
    count = 0
    settled: set[tuple[int, str, bool]] = set()
    while True:
        for cost, is_whole, step in found:
            heapq.heappush(heap, (cost, count, is_whole, step))
            count += 1
        if not heap:
            return None
        cost, _, is_whole, nearest = heapq.heappop(heap)
        if is_whole:
            return nearest
        place = (nearest.element, nearest.port, nearest.pumped)
        found = ()
        if place not in settled:
            settled.add(place)
            found = _onward(network, wanted, (cost, nearest), settled)


def _set_out(
    network: Network, wanted: WantedChain, around: list[tuple[Arc, str]]
) -> Iterator[tuple[int, bool, _Step]]:
    reached = network.elements[wanted.source].key
    for arc, why in around:
        if wanted.source_port in (None, arc.own_port):
            flaws = (find_link_flaw(network, reached, arc, why),) if why else ()
            step = _Step(arc.far, arc.far_port, arc, None, pumped=False, flaws=flaws)
            yield 1 + sum(each.weight for each in flaws), False, step


def _onward(
    network: Network,
    wanted: WantedChain,
    reached: tuple[int, _Step],
    settled: set[tuple[int, str, bool]],
) -> Iterator[tuple[int, bool, _Step]]:
    cost, step = reached
    if step.element == wanted.target:
        if wanted.target_port in (None, step.port):
            if not step.pumped:
                elements = network.elements
                ends = (elements[wanted.source].key, elements[wanted.target].key)
                lacking = find_no_pump(*ends)
                step.flaws = (*step.flaws, lacking)
                cost += lacking.weight
            yield cost, True, step
    elif step.element != wanted.source:
        for longer in _go_on(network, step, settled):
            yield cost + 1 + sum(each.weight for each in longer.flaws), False, longer


def _go_on(network: Network, step: _Step, settled: set[tuple[int, str, bool]]) -> Iterator[_Step]:
    element = network.elements[step.element]
    pumped = step.pumped or element.role is ElementRole.PUMP
    for arc, why in _all_arcs(network)[step.element]:
        if (arc.far, arc.far_port, pumped) in settled:
            continue
        if arc.tube is step.arc.tube and element.role is not ElementRole.PUMP:
            continue
        flaws: tuple[Flaw, ...] = ()
        if Medium.LIQUID is arc.tube.medium is step.arc.tube.medium:
            flaws = tuple(find_flaws(network, step.element, step.port, arc))
        if why:
            flaws = (*flaws, find_link_flaw(network, element.key, arc, why))
        yield _Step(arc.far, arc.far_port, arc, step, pumped, flaws)


def _all_arcs(network: Network) -> list[list[tuple[Arc, str]]]:
    """Return each way out of each element, those that do not conduct liquid with why."""
    if network.around is not None:
        return network.around
    around: list[list[tuple[Arc, str]]] = [[(arc, "") for arc in arcs] for arcs in network.arcs]
    for tube in network.tubes:
        ends = (network.index.get(tube.source), network.index.get(tube.target))
        if ends[0] is None or ends[1] is None or ends[0] == ends[1]:
            continue
        forth = Arc(tube.source_port, ends[1], tube.target_port, tube, 0)
        back = Arc(tube.target_port, ends[0], tube.source_port, tube, 0)
        if tube.medium is not Medium.LIQUID:
            around[ends[0]].append((forth, "medium"))
            around[ends[1]].append((back, "medium"))
        elif not tube.is_two_way:
            around[ends[1]].append((back, "direction"))
    network.around = around
    return around


def _are_joined(network: Network, wanted: WantedChain) -> bool:
    """Tell whether links of any sort lead from one to the other; each network is asked once."""
    if network.islands is None:
        around = _all_arcs(network)
        islands = [-1] * len(around)
        for start in range(len(around)):
            if islands[start] < 0:
                for place in _around(around, start):
                    islands[place] = start
        network.islands = islands
    return network.islands[wanted.source] == network.islands[wanted.target]


def _around(around: list[list[tuple[Arc, str]]], start: int) -> Iterator[int]:
    """Yield everything that links join to a start, nearest first, itself included."""
    seen = {start}
    waiting = [start]
    for here in waiting:
        yield here
        for arc, _ in around[here]:
            if arc.far not in seen:
                seen.add(arc.far)
                waiting.append(arc.far)


def _apart(network: Network, wanted: WantedChain) -> Finding:
    source, target = network.elements[wanted.source].key, network.elements[wanted.target].key
    around = _all_arcs(network)
    sides = [
        [network.elements[place].key for place in islice(_around(around, start), 1, _LISTED + 2)]
        for start in (wanted.source, wanted.target)
    ]
    texts = [", ".join(side[:_LISTED]) + (" …" if len(side) > _LISTED else "") for side in sides]
    message = (
        f"nothing joins {source} to {target}: {source} is joined to {texts[0] or 'nothing'}, and "
        f"{target} to {texts[1] or 'nothing'}; a tube between the two is missing"
    )
    context = {"source": source, "target": target, "reached": sides[0], "reaches_target": sides[1]}
    return Finding("plan.no_route", message, source, context)
