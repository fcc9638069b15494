"""What keeps liquid from getting through an element, or along a link."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.port_network import Arc, Network, conducts
from labweb.domain.graph.ports_and_connections import Medium

_SMALL, _MIDDLE, _LARGE = 10**6, 2 * 10**6, 10**9


@dataclass(frozen=True, slots=True)
class Flaw:
    """One thing that keeps liquid from going on."""

    code: str
    tell: Callable[[], str]
    """Says which element is reached and what is missing after it; asked only when told."""

    element: str
    weight: int


def _flaw(code: str, tell: Callable[[], str], element: str, weight: int = _SMALL) -> Flaw:
    return Flaw(code, tell, element, weight)


def find_link_flaw(network: Network, reached: str, arc: Arc, why: str) -> Flaw:
    """Say why a link does not lead on from the element that liquid reaches."""
    far = network.elements[arc.far].key
    if why == "medium":
        return _flaw(
            "plan.wrong_medium",
            lambda: (
                f"liquid reaches {reached}; from there only link {arc.tube.key} leads to {far}, "
                f"and it carries no liquid ({arc.tube.medium.value}): a tube is missing"
            ),
            reached,
            _LARGE,
        )
    return _flaw(
        "plan.wrong_way",
        lambda: (
            f"liquid reaches {reached}; the tube {arc.tube.key} conducts from {far} to {reached} "
            "and not back: a tube the other way is missing"
        ),
        reached,
    )


def find_flaws(network: Network, index: int, entered: str, arc: Arc) -> Iterator[Flaw]:
    """Yield why liquid that entered an element by a port does not leave it by an arc."""
    element = network.elements[index]
    if element.role is ElementRole.PUMP:
        yield from _syringe(network, index, entered, arc)
    elif element.role is ElementRole.VALVE:
        yield from _valve(network, index, entered, arc)
    elif element.role is ElementRole.SOLENOID:
        ports = (entered, arc.own_port)
        divides = any(_divides(network, index, port) for port in ports)
        if divides or conducts(network, index, entered, arc) is None:
            yield _flaw(
                "plan.tee",
                lambda: f"liquid reaches {element.key}; more than two tubes are joined to it",
                element.key,
            )
    else:
        yield _flaw(
            "plan.vessel_between" if element.role is ElementRole.VESSEL else "plan.no_conductor",
            lambda: (
                f"liquid reaches {element.key}, which is {_what(network, index)}: "
                f"a way around it to {network.elements[arc.far].key} is missing"
            ),
            element.key,
        )


def find_no_pump(source: str, target: str) -> Flaw:
    """Say that nothing moves the liquid."""
    return _flaw(
        "plan.no_pump",
        lambda: (
            f"tubes and valves lead from {source} to {target}, and no syringe pump is on the way: "
            "nothing moves the liquid"
        ),
        target,
        _MIDDLE,
    )


def _what(network: Network, index: int) -> str:
    element = network.elements[index]
    return {
        ElementRole.VESSEL: "a vessel, and no transfer leads through one",
        ElementRole.MANIFOLD: "a manifold and leads on only when a request says through what",
        ElementRole.CARTRIDGE: "a cartridge and leads on only when a request names it",
        ElementRole.GAS: "a source of gas",
        ElementRole.VACUUM: "a vacuum line",
    }.get(element.role, f"a {element.kind or 'device'} that nobody says conducts liquid")


def _divides(network: Network, index: int, port: str) -> bool:
    return any(network.divides(index, port, drawn=drawn) for drawn in (True, False))


def _valve(network: Network, index: int, entered: str, arc: Arc) -> Iterator[Flaw]:
    element = network.elements[index]
    if not (entered and arc.own_port):
        yield _flaw(
            "plan.port_unnamed",
            lambda: (
                f"liquid reaches {element.key}; a link names no port of it, so it cannot be "
                f"turned towards {network.elements[arc.far].key}: name the port"
            ),
            element.key,
        )
    elif element.position(entered, arc.own_port) is None:
        yield _flaw(
            "plan.valve_cannot_join",
            lambda: (
                f"liquid reaches port {entered!r} of {element.key}, which never joins it to port "
                f"{arc.own_port!r} towards {network.elements[arc.far].key}: "
                f"{_why_not(network, index, is_same=entered == arc.own_port)}"
            ),
            element.key,
        )
    else:
        for port in dict.fromkeys((entered, arc.own_port)):
            if _divides(network, index, port):
                yield _tee(network, index, port)


def _why_not(network: Network, index: int, *, is_same: bool) -> str:
    element = network.elements[index]
    if is_same:
        return "the tubes that liquid comes by and goes on by are joined to one port"
    if element.positions:
        return "none of its positions does"
    if element.common_port is None:
        return "nobody says which of its ports is the common one"
    return f"its common port {element.common_port!r} is joined to one other at a time"


def _tee(network: Network, index: int, port: str) -> Flaw:
    element = network.elements[index]

    def tell() -> str:
        joined = {
            tube.target if tube.source == element.key else tube.source
            for tube in network.tubes
            if tube.medium is Medium.LIQUID
            and (element.key, port)
            in ((tube.source, tube.source_port), (tube.target, tube.target_port))
        }
        return (
            f"liquid reaches {element.key}; its port {port!r} is joined to "
            f"{' and '.join(sorted(joined))}, and the flow would divide there: "
            "give each tube a port of its own"
        )

    return _flaw("plan.tee", tell, element.key)


def _syringe(network: Network, index: int, entered: str, arc: Arc) -> Iterator[Flaw]:
    element = network.elements[index]
    if not element.capacity_nl:
        yield _flaw(
            "plan.unknown_syringe",
            lambda: f"liquid reaches {element.key}; nobody says how much its syringe holds",
            element.key,
        )
    drawn = network.divides(index, entered, drawn=True)
    pushed = network.divides(index, arc.own_port, (arc.far, arc.far_port), drawn=False)
    if element.selects and not (entered and arc.own_port):
        yield _flaw(
            "plan.port_unnamed",
            lambda: f"liquid reaches {element.key}; a link names no port of it: name the port",
            element.key,
        )
    elif element.selects and (drawn or pushed):
        yield _tee(network, index, entered if drawn else arc.own_port)
    elif drawn or pushed:
        yield _flaw(
            "plan.ambiguous_port",
            lambda: (
                f"liquid reaches {element.key}, a syringe with {len(network.joined[index])} tubes "
                f"and no valve: where it {'draws from' if drawn else 'pushes to'} cannot be "
                "chosen; a valve is missing"
            ),
            element.key,
        )
