"""Which valves join a vessel to a vacuum line or a source of gas, with no syringe between."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from labweb.domain.graph.elements import Element, ElementRole
from labweb.domain.recipes.on_rig.equipment import Equipment

_PASSED = frozenset({ElementRole.VALVE, ElementRole.SOLENOID, ElementRole.MANIFOLD})


@dataclass(frozen=True, slots=True)
class GasLine:
    """A way to a vacuum line or a source of gas, and where each valve on it must stand."""

    end: str
    valves: tuple[tuple[str, str], ...] = ()
    """Valve and port or position, in order from the vessel."""

    solenoids: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Reached:
    key: str
    port: str
    valves: tuple[tuple[str, str], ...]
    solenoids: tuple[str, ...]


def find_line(
    equipment: Equipment, start: str, is_end: Callable[[str], bool], port: str | None = None
) -> GasLine | None:
    """Find the line with the fewest tubes; equals are settled by ids. None: there is none."""
    ways = equipment.ways
    queue = deque([_Reached(start, "", (), ())])
    seen = {(start, "")}
    while queue:
        here = queue.popleft()
        for own_port, far, far_port in ways.get(here.key, ()):
            if here.key == start and port is not None and own_port != port:
                continue
            there = _through(equipment.elements[here.key], here, own_port, start)
            if there is None:
                continue
            if is_end(far):
                return GasLine(far, there.valves, there.solenoids)
            if equipment.elements[far].role in _PASSED and (far, far_port) not in seen:
                seen.add((far, far_port))
                queue.append(_Reached(far, far_port, there.valves, there.solenoids))
    return None


def vacuum_line(equipment: Equipment, vessel: str, port: str | None = None) -> GasLine | None:
    """Find the line that joins a vessel to a vacuum; None: there is none."""
    return find_line(
        equipment, vessel, lambda key: equipment.elements[key].role is ElementRole.VACUUM, port
    )


def drawn_with(equipment: Equipment, pump: str) -> list[str]:
    """List the vessels that a vacuum pump draws on whenever it runs: no valve is between."""
    ways = equipment.ways
    waiting, seen, found = [pump], {pump}, set()
    while waiting:
        for _, far, _ in ways.get(waiting.pop(), ()):
            role = equipment.elements[far].role
            if far in equipment.vessels:
                found.add(far)
            elif (
                role in (ElementRole.VACUUM, ElementRole.MANIFOLD, ElementRole.CARTRIDGE)
                and far not in seen
            ):
                seen.add(far)
                waiting.append(far)
    return sorted(found)


def _through(element: Element, here: _Reached, out_port: str, start: str) -> _Reached | None:
    """Return what must be set to leave an element by a port; None: it cannot be."""
    if element.key == start or element.role is ElementRole.MANIFOLD:
        return here
    if out_port == here.port:
        return None
    if element.role is ElementRole.SOLENOID:
        return _Reached(here.key, here.port, here.valves, (*here.solenoids, element.key))
    position = element.position(here.port, out_port)
    if position is None or any(key == element.key for key, _ in here.valves):
        return None
    return _Reached(here.key, here.port, (*here.valves, (element.key, position)), here.solenoids)


def resting_port(equipment: Equipment, valve: str, busy: str) -> str | None:
    """Return where a valve joins neither gas nor vacuum: best a port without a tube."""
    element = equipment.elements[valve]
    if element.positions:
        return next((name for name in sorted(element.positions) if name != busy), None)
    joined: dict[str, set[str]] = {}
    for own_port, far, _ in equipment.ways.get(valve, ()):
        joined.setdefault(own_port, set()).add(far)
    free = sorted((element.ports or frozenset()) - joined.keys() - {element.common_port})
    if free:
        return free[0]
    for port, ends in sorted(joined.items()):
        is_quiet = all(
            equipment.elements[end].role is not ElementRole.VACUUM and equipment.gas(end) == ""
            for end in ends
        )
        if port not in (element.common_port, busy) and is_quiet:
            return port
    return None
