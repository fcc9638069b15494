"""What the classes of lab graphs are, and which ports they have.

Source:
    Chemputer graphs: the classes and ports of the published rigs (Steiner et al., Science 363
    (2019) eaav2211 and the XDL graph files after it). Uni-Lab-OS graphs: the classes, types
    and port names of the published stations.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.ports_and_connections import Medium


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeClass:
    """What a class says about an element."""

    role: ElementRole
    ports: frozenset[str] | None = None
    common_port: str | None = None
    leave_by: str | None = None
    enter_by: str | None = None
    medium: Medium = Medium.LIQUID
    """What a link to it carries."""


def _six() -> frozenset[str]:
    return frozenset(str(port) for port in range(-1, 6))


_ROTAVAP = NodeClass(role=ElementRole.VESSEL, leave_by="evaporate", enter_by="evaporate")
_STIRRER = NodeClass(role=ElementRole.OTHER, medium=Medium.MECHANICAL)
_HEATER = NodeClass(role=ElementRole.OTHER, medium=Medium.THERMAL)
_SENSOR = NodeClass(role=ElementRole.OTHER, medium=Medium.ELECTRICAL)
_LAMP = NodeClass(role=ElementRole.OTHER, medium=Medium.ELECTRICAL)
_VACUUM = NodeClass(role=ElementRole.VACUUM, medium=Medium.VACUUM)

CHEMPUTER: Mapping[str, NodeClass] = {
    "valve": NodeClass(role=ElementRole.VALVE, ports=_six(), common_port="-1"),
    "pump": NodeClass(role=ElementRole.PUMP, ports=frozenset("0")),
    "flask": NodeClass(role=ElementRole.VESSEL),
    "collectionflask": NodeClass(role=ElementRole.VESSEL),
    "waste": NodeClass(role=ElementRole.VESSEL),
    "reactor": NodeClass(role=ElementRole.VESSEL, ports=frozenset("012")),
    "separator": NodeClass(
        role=ElementRole.VESSEL,
        ports=frozenset(("top", "bottom")),
        leave_by="bottom",
        enter_by="bottom",
    ),
    "filter": NodeClass(
        role=ElementRole.VESSEL,
        ports=frozenset(("top", "bottom")),
        leave_by="bottom",
        enter_by="top",
    ),
    "cartridge": NodeClass(role=ElementRole.CARTRIDGE),
    "column": NodeClass(role=ElementRole.CARTRIDGE),
    "manifold": NodeClass(role=ElementRole.MANIFOLD),
    "vacuum": _VACUUM,
    "rotavap": _ROTAVAP,
}
"""What follows `Chemputer` in a class of such a graph."""

_INSTRUMENTS: tuple[tuple[re.Pattern[str], NodeClass], ...] = tuple(
    (re.compile(pattern), sort)
    for pattern, sort in (
        (r"rv_?10|rotavap|rotovap|r300", _ROTAVAP),
        (r"cvc3000|vacuum", _VACUUM),
        (r"pneumatic", NodeClass(role=ElementRole.OTHER, medium=Medium.GAS)),
        (r"heitorque|rzr_?2052|microstar|stirrer|vortex", _STIRRER),
        (
            r"hot_?plate|rct|ret_?control|ret_?visc|julabo|cf41|huber|heat|chill|cool|cryo",
            _HEATER,
        ),
        (r"ultra_?so|sonic", _STIRRER),
        (r"microwave|condenser|still", _HEATER),
        (r"lamp|light|led$", _LAMP),
        (r"sensor|camera|meter$", _SENSOR),
    )
)

_WORDS: tuple[tuple[re.Pattern[str], ElementRole], ...] = tuple(
    (re.compile(pattern), role)
    for pattern, role in (
        (r"gas_?source|gassource", ElementRole.GAS),
        (r"solenoid", ElementRole.SOLENOID),
        (r"pump", ElementRole.PUMP),
        (r"valve", ElementRole.VALVE),
        (r"manifold", ElementRole.MANIFOLD),
        (r"cartridge|column", ElementRole.CARTRIDGE),
        (
            r"container|flask|bottle|vial|reactor|waste|separator|filter|vessel|beaker|tube(?!_?rack)"
            r"|trough|well|centrifuge",
            ElementRole.VESSEL,
        ),
    )
)

COMMON_NAMES = frozenset(
    {"-1", "common", "com", "center", "centre", "transferpump", "multiway-valve-inlet"}
)
"""Names that a rotary valve's fixed port goes by."""


def chemputer_sort(name: str) -> NodeClass | None:
    """Return what a Chemputer class is; None for a class of other makers.

    Example:
        >>> chemputer_sort("ChemputerValve").role, chemputer_sort("chemputer_pump").role
        (<Role.VALVE: 'valve'>, <Role.PUMP: 'pump'>)
    """
    word = name.lower().replace("_", "")
    return CHEMPUTER.get(word.removeprefix("chemputer")) if word.startswith("chemputer") else None


def instrument_sort(name: str) -> NodeClass | None:
    """Return what an instrument is that touches no liquid, or a rotary evaporator."""
    word = name.lower()
    return next((sort for pattern, sort in _INSTRUMENTS if pattern.search(word)), None)


def role_by_words(*names: str) -> ElementRole | None:
    """Return the role that the words of a class or type name, or None.

    Example:
        >>> role_by_words("virtual_multiway_valve")
        <Role.VALVE: 'valve'>
        >>> role_by_words("syringe_pump_with_valve.runze.SY03B-T08")
        <Role.PUMP: 'pump'>
    """
    for name in names:
        word = name.lower()
        found = next((role for pattern, role in _WORDS if pattern.search(word)), None)
        if found is not None:
            return found
    return None
