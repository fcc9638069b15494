"""Why no chain leads from one vessel to another: the breaks of the way that has fewest."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from labweb.domain.errors import Finding
from labweb.domain.graph.chain import Wanted
from labweb.domain.graph.elements import Element, Role, Tube
from labweb.domain.graph.network import Arc, Network, conducts
from labweb.domain.graph.topology import Medium

_SMALL, _LARGE = 10**6, 10**9
_LISTED = 8


@dataclass(frozen=True, slots=True)
class Break:
    """One thing that keeps liquid from going on."""

    code: str
    message: str
    element: str
    weight: int


def _break(code: str, message: str, element: str, weight: int = _SMALL) -> Break:
    return Break(code, message, element, weight)


@dataclass(slots=True)
class _Step:
    element: int
    port: str
    arc: Arc
    parent: _Step | None
    pumped: bool
    breaks: tuple[Break, ...]


def find_breaks(network: Network, wanted: Wanted, defects: tuple[Finding, ...]) -> list[Finding]:
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
    last = _least_broken(network, wanted)
    if last is None:
        return [_apart(network, wanted), *_relevant(defects, source.key, target.key)]
    steps = [last]
    while steps[-1].parent is not None:
        steps.append(steps[-1].parent)
    steps.reverse()
    findings: list[Finding] = []
    way = [source.key, *(elements[step.element].key for step in steps)]
    for each in (b for step in steps for b in step.breaks):
        context = {"source": source.key, "target": target.key, "reached": each.element, "way": way}
        findings.append(Finding(each.code, each.message, each.element, context))
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


def _dead_ends(network: Network, wanted: Wanted) -> list[Finding]:
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


def _least_broken(network: Network, wanted: Wanted) -> _Step | None:
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
            found = _onward(network, wanted, around, (cost, nearest))


def _set_out(
    network: Network, wanted: Wanted, around: list[tuple[Arc, str]]
) -> Iterator[tuple[int, bool, _Step]]:
    reached = network.elements[wanted.source].key
    for arc, flaw in around:
        if wanted.source_port in (None, arc.own_port):
            breaks = (flaw_break(network, reached, arc, flaw),) if flaw else ()
            step = _Step(arc.far, arc.far_port, arc, None, pumped=False, breaks=breaks)
            yield 1 + sum(each.weight for each in breaks), False, step


def _onward(
    network: Network,
    wanted: Wanted,
    around: list[list[tuple[Arc, str]]],
    reached: tuple[int, _Step],
) -> Iterator[tuple[int, bool, _Step]]:
    cost, step = reached
    if step.element == wanted.target:
        if wanted.target_port in (None, step.port):
            if not step.pumped:
                lacking = _no_pump(network, wanted)
                step.breaks = (*step.breaks, lacking)
                cost += lacking.weight
            yield cost, True, step
    elif step.element != wanted.source:
        for longer in _go_on(network, step, around[step.element]):
            yield cost + 1 + sum(each.weight for each in longer.breaks), False, longer


def _go_on(network: Network, step: _Step, around: list[tuple[Arc, str]]) -> Iterator[_Step]:
    element = network.elements[step.element]
    for arc, flaw in around:
        if arc.tube is step.arc.tube and element.role is not Role.PUMP:
            continue
        is_liquid = Medium.LIQUID is arc.tube.medium is step.arc.tube.medium
        breaks = list(_stand(network, step, arc)) if is_liquid else []
        if flaw:
            breaks.append(flaw_break(network, element.key, arc, flaw))
        pumped = step.pumped or element.role is Role.PUMP
        yield _Step(arc.far, arc.far_port, arc, step, pumped, tuple(breaks))


def _all_arcs(network: Network) -> list[list[tuple[Arc, str]]]:
    """Return each way out of each element, those that do not conduct liquid with why."""
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
    return around


def flaw_break(network: Network, reached: str, arc: Arc, flaw: str) -> Break:
    """Say why a tube does not lead on from the element that liquid reaches."""
    far = network.elements[arc.far].key
    if flaw == "medium":
        message = (
            f"liquid reaches {reached}; from there only link {arc.tube.key} leads to {far}, and it "
            f"carries no liquid ({arc.tube.medium.value}): a tube is missing"
        )
        return _break("plan.wrong_medium", message, reached, _LARGE)
    message = (
        f"liquid reaches {reached}; the tube {arc.tube.key} conducts from {far} to {reached} "
        "and not back: a tube the other way is missing"
    )
    return _break("plan.wrong_way", message, reached)


def _stand(network: Network, step: _Step, arc: Arc) -> Iterator[Break]:
    """Yield why liquid does not get through the element between a step and an arc."""
    element = network.elements[step.element]
    far = network.elements[arc.far].key
    if element.role is Role.PUMP:
        yield from _syringe(network, step, arc)
        return
    if element.role is Role.VALVE:
        yield from _valve(network, step, arc, far)
        return
    if element.role is Role.SOLENOID:
        ports = (step.port, arc.own_port)
        divides = any(
            network.divides(step.element, p, drawn=d) for p in ports for d in (True, False)
        )
        if divides or conducts(network, step.element, step.port, arc) is None:
            message = f"liquid reaches {element.key}; more than two tubes are joined to it"
            yield _break("plan.tee", message, element.key)
        return
    through = {
        Role.VESSEL: "a vessel, and no transfer leads through one",
        Role.MANIFOLD: "a manifold and leads on only when a request says through what",
        Role.CARTRIDGE: "a cartridge and leads on only when a request names it",
        Role.GAS: "a source of gas",
        Role.VACUUM: "a vacuum line",
    }.get(element.role, f"a {element.kind or 'device'} that nobody says conducts liquid")
    message = (
        f"liquid reaches {element.key}, which is {through}: a way around it to {far} is missing"
    )
    yield _break(
        "plan.vessel_between" if element.role is Role.VESSEL else "plan.no_conductor",
        message,
        element.key,
    )


def _valve(network: Network, step: _Step, arc: Arc, far: str) -> Iterator[Break]:
    element = network.elements[step.element]
    unnamed = [port for port in (step.port, arc.own_port) if not port]
    if unnamed:
        message = (
            f"liquid reaches {element.key}; the link names no port of it, so it cannot be turned "
            f"towards {far}: name the port"
        )
        yield _break("plan.port_unnamed", message, element.key)
        return
    if element.position(step.port, arc.own_port) is None:
        if element.common_port is None and not element.positions:
            why = "nobody says which of its ports is the common one"
        elif element.positions:
            why = "none of its positions does"
        else:
            why = f"its common port {element.common_port!r} is joined to one other at a time"
        message = (
            f"liquid reaches port {step.port!r} of {element.key}, which never joins it to port "
            f"{arc.own_port!r} towards {far}: {why}"
        )
        yield _break("plan.valve_cannot_join", message, element.key)
        return
    for port in dict.fromkeys((step.port, arc.own_port)):
        if network.divides(step.element, port, drawn=True) or network.divides(
            step.element, port, drawn=False
        ):
            yield _tee(network, step.element, port)


def _tee(network: Network, index: int, port: str) -> Break:
    element = network.elements[index]
    joined = sorted(
        {
            tube.target if tube.source == element.key else tube.source
            for tube in network.tubes
            if tube.medium is Medium.LIQUID
            and (element.key, port)
            in ((tube.source, tube.source_port), (tube.target, tube.target_port))
        }
    )
    message = (
        f"liquid reaches {element.key}; its port {port!r} is joined to {' and '.join(joined)}, "
        "and the flow would divide there: give each tube a port of its own"
    )
    return _break("plan.tee", message, element.key)


def _syringe(network: Network, step: _Step, arc: Arc) -> Iterator[Break]:
    element = network.elements[step.element]
    if not element.capacity_nl:
        message = f"liquid reaches {element.key}; nobody says how much its syringe holds"
        yield _break("plan.unknown_syringe", message, element.key)
    drawn = network.divides(step.element, step.port, drawn=True)
    pushed = network.divides(step.element, arc.own_port, drawn=False)
    if element.selects and not (step.port and arc.own_port):
        message = f"liquid reaches {element.key}; a link names no port of it: name the port"
        yield _break("plan.port_unnamed", message, element.key)
    elif element.selects and (drawn or pushed):
        yield _tee(network, step.element, step.port if drawn else arc.own_port)
    elif drawn or pushed:
        tubes = sorted({each.tube.key for each in network.arcs[step.element]})
        message = (
            f"liquid reaches {element.key}, a syringe with {len(tubes)} tubes and no valve: "
            f"where it {'draws from' if drawn else 'pushes to'} cannot be chosen; "
            "a valve is missing"
        )
        yield _break("plan.ambiguous_port", message, element.key)


def _no_pump(network: Network, wanted: Wanted) -> Break:
    source, target = network.elements[wanted.source].key, network.elements[wanted.target].key
    message = (
        f"tubes and valves lead from {source} to {target}, and no syringe pump is on the way: "
        "nothing moves the liquid"
    )
    return _break("plan.no_pump", message, target, 2 * _SMALL)


def _apart(network: Network, wanted: Wanted) -> Finding:
    source, target = network.elements[wanted.source].key, network.elements[wanted.target].key
    sides = []
    for start in (wanted.source, wanted.target):
        around = _all_arcs(network)
        seen = {start}
        waiting = [start]
        for here in waiting:
            for arc, _ in around[here]:
                if arc.far not in seen:
                    seen.add(arc.far)
                    waiting.append(arc.far)
        sides.append([network.elements[place].key for place in waiting[1:]])
    texts = [", ".join(side[:_LISTED]) + (" …" if len(side) > _LISTED else "") for side in sides]
    message = (
        f"nothing joins {source} to {target}: {source} is joined to {texts[0] or 'nothing'}, and "
        f"{target} to {texts[1] or 'nothing'}; a tube between the two is missing"
    )
    context = {"source": source, "target": target, "reached": sides[0], "reaches_target": sides[1]}
    return Finding("plan.no_route", message, source, context)
