"""Search the settings of valves and solenoids in which a syringe is joined to something.

Written apart from the walk of `flow`, so that each can be held against the other: this one asks
which settings there are, that one what a given setting joins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from tests.judge.flow import Sense
from tests.judge.rig import End, Hose, Kind, Rig

_MOST_SETTINGS = 200_000


class TooManyError(RuntimeError):
    """The rig has more settings than can be searched."""


@dataclass(frozen=True)
class Setting:
    """What is known so far of valves and solenoids."""

    positions: tuple[tuple[str, str], ...] = ()
    """Rotary valves that stand on a port."""
    avoids: tuple[tuple[str, str], ...] = ()
    """Rotary valves that stand on some other port than this."""
    opened: frozenset[str] = frozenset()
    shut: frozenset[str] = frozenset()

    def position(self, valve: str) -> str | None:
        """Return the port on which a valve has been set."""
        return dict(self.positions).get(valve)

    def is_avoided(self, end: End) -> bool:
        """Tell whether a valve has been set not to stand on a port."""
        return end in self.avoids


@dataclass(frozen=True)
class Way:
    """A setting, and all that a syringe is joined to in it."""

    setting: Setting = Setting()
    vessels: frozenset[End] = frozenset()
    pumps: frozenset[str] = frozenset()
    is_sure: bool = True
    """No hose is shut by the direction of an edge beside another hose."""


@dataclass(frozen=True)
class _Task:
    end: End
    hose: Hose | None
    is_arrival: bool


class _Search:
    def __init__(self, rig: Rig, sense: Sense, start: str) -> None:
        self.rig, self.sense, self.start, self.count = rig, sense, start, 0

    def grow(self, way: Way, tasks: tuple[_Task, ...], left: frozenset[End]) -> Iterator[Way]:
        """Work off what is still to be followed, choosing where a valve may stand."""
        self.count += 1
        if self.count > _MOST_SETTINGS:
            raise TooManyError(f"{self.start}: too many settings")
        if len({name for name, _ in way.vessels}) > 1:
            return
        if not tasks:
            yield way
            return
        task, rest = tasks[0], tasks[1:]
        if not task.is_arrival:
            yield from self._leave(way, task, rest, left)
            return
        for choice, added in self._choices(way, task):
            yield from self.grow(choice, added + rest, left)

    def _leave(
        self, way: Way, task: _Task, rest: tuple[_Task, ...], left: frozenset[End]
    ) -> Iterator[Way]:
        if task.end in left:
            yield from self.grow(way, rest, left)
            return
        others = [hose for hose in self.rig.hoses_at(task.end) if hose is not task.hose]
        added = tuple(
            _Task(hose.other(task.end), hose, is_arrival=True)
            for hose in others
            if hose.carries(task.end if self.sense is Sense.PUSH else hose.other(task.end))
        )
        beside = len(others) + (task.hose is not None) > 1
        sure = way.is_sure and not (beside and len(added) < len(others))
        yield from self.grow(replace(way, is_sure=sure), added + rest, left | {task.end})

    def _choices(self, way: Way, task: _Task) -> Iterator[tuple[Way, tuple[_Task, ...]]]:
        end, device = task.end, self.rig.devices[task.end[0]]
        tee = (_Task(end, task.hose, is_arrival=False),)
        match device.kind:
            case Kind.VESSEL:
                yield replace(way, vessels=way.vessels | {end}), ()
            case Kind.OTHER:
                return
            case Kind.PUMP:
                ends = self.rig.ends_of(device.id)
                through = tuple(_Task(other, task.hose, is_arrival=False) for other in ends)
                found = way.pumps if device.id == self.start else way.pumps | {device.id}
                yield replace(way, pumps=found), through
            case Kind.SOLENOID:
                yield from self._at_solenoid(way, end, tee)
            case Kind.VALVE | Kind.PUMP_VALVE:
                yield from self._at_valve(way, end, tee)

    def _at_solenoid(
        self, way: Way, end: End, tee: tuple[_Task, ...]
    ) -> Iterator[tuple[Way, tuple[_Task, ...]]]:
        name, setting = end[0], way.setting
        far = [other for other in self.rig.ends_of(name) if other != end]
        through = tuple(_Task(other, None, is_arrival=False) for other in far)
        if name not in setting.shut:
            opened = replace(setting, opened=setting.opened | {name})
            yield replace(way, setting=opened), tee + through
        if name not in setting.opened:
            yield replace(way, setting=replace(setting, shut=setting.shut | {name})), tee

    def _at_valve(
        self, way: Way, end: End, tee: tuple[_Task, ...]
    ) -> Iterator[tuple[Way, tuple[_Task, ...]]]:
        device, port = self.rig.devices[end[0]], end[1]
        if not port:
            return
        if device.kind is Kind.VALVE and port == device.common:
            for outer in self._free(way, device.id):
                set_way = _set(way, device.id, outer)
                yield set_way, (*tee, _Task((device.id, outer), None, is_arrival=False))
            return
        if port in self._free(way, device.id):
            here = _set(way, device.id, port)
            if device.kind is Kind.PUMP_VALVE:
                yield replace(here, pumps=here.pumps | {device.id} - {self.start}), tee
            elif self.rig.hoses_at((device.id, device.common)):
                inner = _Task((device.id, device.common), None, is_arrival=False)
                yield here, (*tee, inner)
        yield from self._standing_elsewhere(way, end, tee)

    def _standing_elsewhere(
        self, way: Way, end: End, tee: tuple[_Task, ...]
    ) -> Iterator[tuple[Way, tuple[_Task, ...]]]:
        standing = way.setting.position(end[0])
        if standing is not None:
            if standing != end[1]:
                yield way, tee
            return
        device = self.rig.devices[end[0]]
        ports = {*self.rig.outer_ports(device.id), *device.declared}
        if ports - {end[1]} - {port for name, port in way.setting.avoids if name == end[0]}:
            avoids = (*way.setting.avoids, end)
            yield replace(way, setting=replace(way.setting, avoids=avoids)), tee

    def _free(self, way: Way, valve: str) -> list[str]:
        standing = way.setting.position(valve)
        if standing is not None:
            return [standing]
        ports = self.rig.outer_ports(valve)
        return [port for port in ports if not way.setting.is_avoided((valve, port))]


def _set(way: Way, valve: str, port: str) -> Way:
    if way.setting.position(valve) is not None:
        return way
    positions = (*way.setting.positions, (valve, port))
    return replace(way, setting=replace(way.setting, positions=positions))


def find_ways(rig: Rig, pump: str, sense: Sense, given: Setting | None = None) -> list[Way]:
    """List the ways in which a syringe is joined to anything, none of them open to elsewhere."""
    search = _Search(rig, sense, pump)
    setting = given or Setting()
    starts: list[tuple[Setting, tuple[End, ...]]] = []
    if rig.devices[pump].kind is Kind.PUMP_VALVE:
        standing = setting.position(pump)
        for port in [standing] if standing is not None else rig.outer_ports(pump):
            at_port = _set(Way(setting), pump, port).setting
            starts.append((at_port, ((pump, port),)))
    else:
        starts.append((setting, tuple(rig.ends_of(pump))))
    found: list[Way] = []
    for at_start, ends in starts:
        tasks = tuple(_Task(end, None, is_arrival=False) for end in ends)
        found += search.grow(Way(at_start), tasks, frozenset())
    return [way for way in found if way.vessels or way.pumps]
