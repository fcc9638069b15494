"""Nodes of a graph file as elements, and its links as tubes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from functools import lru_cache
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import NL_PER_ML, Element, ElementRole, Tube
from labweb.domain.graph.lab_file.uni_lab_os.node_liquid import nl_per_unit
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.rig.node_classes import (
    COMMON_NAMES,
    NodeClass,
    chemputer_sort,
    instrument_sort,
    role_by_words,
)

_MEDIA: Mapping[str, Medium] = {
    "fluid": Medium.LIQUID,
    "thermal": Medium.THERMAL,
    "mechanical": Medium.MECHANICAL,
    "communication": Medium.COMMUNICATION,
    "transport": Medium.TRANSPORT,
    "electrical": Medium.ELECTRICAL,
    "gas": Medium.GAS,
    "vacuum": Medium.VACUUM,
}
_LARGEST_NL = 10_000_000 * NL_PER_ML
_PLAIN = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_OTHER = NodeClass(role=ElementRole.OTHER)
_ENDS = 2
_MOST_PORTS = 64


def sort_of(node: Mapping[str, Any]) -> NodeClass:
    """Return what a node is, by its class and type and never by its name."""
    return _sort(str(node.get("class") or ""), str(node.get("type") or ""))


@lru_cache(maxsize=1024)
def _sort(name: str, type_: str) -> NodeClass:
    found = chemputer_sort(name)
    if found is not None:
        return found
    role = role_by_words(name)
    instrument = instrument_sort(name)
    if instrument is not None and role in (None, ElementRole.PUMP):
        return instrument
    if role is None and type_ != "device":
        role = role_by_words(type_)
    return _OTHER if role is None else NodeClass(role=role)


def element_of(key: str, node: Mapping[str, Any]) -> Element:
    """Make an element of a node."""
    sort = sort_of(node)
    name = str(node.get("class") or node.get("type") or "")
    config = node.get("config")
    places: list[Mapping[str, Any]] = [config] if isinstance(config, Mapping) else []
    places.append(node)
    unit = nl_per_unit(config)
    return Element(
        key=key,
        role=sort.role,
        kind=name,
        common_port=_text(places, "common_port") or sort.common_port,
        ports=sort.ports,
        positions=_positions(places),
        selects=sort.role is ElementRole.PUMP and "valve" in name.lower(),
        capacity_nl=_capacity(places, unit) if sort.role is ElementRole.PUMP else None,
        leave_by=sort.leave_by,
        enter_by=sort.enter_by,
        attributes=node,
        nl_per_unit=unit,
    )


def _text(places: list[Mapping[str, Any]], name: str) -> str | None:
    for place in places:
        value = place.get(name)
        if isinstance(value, str | int) and not isinstance(value, bool) and value != "":
            return str(value)
    return None


def _positions(places: list[Mapping[str, Any]]) -> dict[str, frozenset[frozenset[str]]]:
    """Read `{"load": [["1", "2"], …]}` of a two-position or injection valve."""
    for place in places:
        value = place.get("joins")
        if isinstance(value, Mapping):
            return {
                str(position): frozenset(
                    frozenset(str(port) for port in pair)
                    for pair in (pairs if isinstance(pairs, list) else ())
                    if isinstance(pair, list) and len(pair) == _ENDS
                )
                for position, pairs in sorted(value.items())
            }
    return {}


def _capacity(places: list[Mapping[str, Any]], unit: int) -> int | None:
    """Return what a syringe holds."""
    found = (volume_nl(place.get("max_volume"), unit) for place in places)
    return next((amount for amount in found if amount), None)


def volume_nl(value: object, unit: int = NL_PER_ML) -> int | None:
    """Return a volume as a file states it in whole nanolitres; None: no volume.

    What is left below a nanolitre is dropped: a size is never taken as larger than it is said
    to be. `check_volumes` refuses contents that are not whole nanolitres.

    Args:
        value: The volume as the file has it, in units of its node.
        unit: Nanolitres in one unit: files state millilitres, nodes of PyLabRobot microlitres
            (`Element.nl_per_unit`).

    Example:
        >>> volume_nl("25.0"), volume_nl(360, 1000), volume_nl(-1.0), volume_nl("much")
        (25000000, 360000, None, None)
    """
    number = decimal(value)
    if number is None or not 0 <= number * unit < _LARGEST_NL:
        return None
    return int(number * unit)


def decimal(value: object) -> Decimal | None:
    """Return a number as a file says it, as number or as text in digits; None: it is none.

    Example:
        >>> decimal(" 2.50 "), decimal("1_000"), decimal("\u0665"), decimal("1e3")
        (Decimal('2.50'), None, None, None)
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str):
        plain = value.strip()
        return Decimal(plain) if _PLAIN.fullmatch(plain) else None
    found = Decimal(str(value))
    return found if found.is_finite() else None


def named_volume(entry: object) -> tuple[object, object] | None:
    """Return name and volume of a liquid in a list of them, as files write it; None: it is none.

    Example:
        >>> named_volume({"liquid_type": "water", "liquid_volume": 5}), named_volume(["DMF", 2.0])
        (('water', 5), ('DMF', 2.0))
    """
    if isinstance(entry, Mapping):
        for name, volume in (("liquid_type", "liquid_volume"), ("name", "volume")):
            if volume in entry:
                return entry.get(name), entry[volume]
    elif isinstance(entry, list | tuple) and len(entry) == _ENDS:
        return entry[0], entry[1]
    return None


def listed_liquids(said: Mapping[str, Any]) -> Iterator[list[object]]:
    """Yield each list of liquids in an object of a node, as it stands; one alone is a list."""
    if "liquid_volume" in said:
        yield [said]
    for name in ("liquid", "liquids"):
        value = said.get(name)
        if value is not None and value != "":
            yield list(value) if isinstance(value, list | tuple) else [value]


def medium_of(
    link: Mapping[str, Any], ends: tuple[NodeClass, NodeClass], *, chemputer: bool
) -> Medium:
    """Return what a link carries, by its own type or by what it joins."""
    type_ = link.get("type")
    if isinstance(type_, str) and type_ in _MEDIA and type_ != "fluid":
        return _MEDIA[type_]
    if type_ not in ("fluid", "physical") and not (type_ in (None, "") and chemputer):
        return Medium.OTHER
    return next((end.medium for end in ends if end.medium is not Medium.LIQUID), Medium.LIQUID)


def find_common_ports(elements: Iterable[Element], tubes: Iterable[Tube]) -> list[Element]:
    """Give each rotary valve its common port where the class does not say it.

    It is the port with one of the names that such a port goes by, or else the only port
    that a pump without a valve of its own is joined to: such a pump serves nothing on another
    port. When neither tells, the valve has none and is never turned.
    """
    known = {element.key: element for element in elements}
    joined: dict[str, list[tuple[str, Element | None]]] = {}
    for tube in tubes:
        if tube.medium is Medium.LIQUID:
            joined.setdefault(tube.source, []).append((tube.source_port, known.get(tube.target)))
            joined.setdefault(tube.target, []).append((tube.target_port, known.get(tube.source)))
    return [
        replace(element, common_port=_common(joined.get(element.key, [])))
        if element.role is ElementRole.VALVE
        and element.common_port is None
        and not element.positions
        else element
        for element in known.values()
    ]


def count_ports(elements: Iterable[Element], tubes: Iterable[Tube]) -> list[Element]:
    """Give a rotary valve the ports that its `positions` count: 1 and so on, and the common one.

    A valve at which a tube is joined to yet another port keeps what is known of it: nothing.

    Source:
        `config.positions` of the multiway valves in the published Uni-Lab-OS stations.
    """
    joined: dict[str, set[str]] = {}
    for tube in tubes:
        joined.setdefault(tube.source, set()).add(tube.source_port)
        joined.setdefault(tube.target, set()).add(tube.target_port)
    return [_counted(element, joined.get(element.key, set())) for element in elements]


def _counted(element: Element, joined: set[str]) -> Element:
    config = element.attributes.get("config")
    count = config.get("positions") if isinstance(config, Mapping) else None
    if element.role is not ElementRole.VALVE or element.ports is not None:
        return element
    if not isinstance(count, int) or isinstance(count, bool) or not 0 < count <= _MOST_PORTS:
        return element
    names = {str(number) for number in range(1, count + 1)} | {element.common_port or ""}
    return replace(element, ports=frozenset(names - {""})) if joined <= names else element


def _common(joined: list[tuple[str, Element | None]]) -> str | None:
    named = {port for port, _ in joined if port.lower() in COMMON_NAMES}
    pumps = {
        port for port, far in joined if far and far.role is ElementRole.PUMP and not far.selects
    }
    for found in (named, pumps):
        if len(found) == 1:
            return found.pop()
    return None


def find_defects(elements: Iterable[Element], tubes: Iterable[Tube]) -> tuple[Finding, ...]:
    """Return one finding for each tube at a port that its element does not have."""
    known = {element.key: element for element in elements}
    found = []
    for tube in tubes:
        if tube.medium is not Medium.LIQUID:
            continue
        ends = ((tube.source, tube.source_port), (tube.target, tube.target_port))
        for key, port in ends:
            element = known[key]
            if port and element.ports is not None and port not in element.ports:
                names = ", ".join(sorted(element.ports))
                message = (
                    f"link {tube.key} joins {key} at port {port!r}, and a "
                    f"{element.kind or element.role} has the ports {names}"
                )
                context = {"element": key, "port": port}
                found.append(Finding("graph.bad_port", message, tube.key, context))
                break
    return tuple(found)
