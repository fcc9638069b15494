"""Whether a transfer can be done on a rig at all, from the graph's definition alone.

A transfer from A to B is feasible when there are syringes P1 … Pk (k ≥ 1, volumes known) such that

    A ══draw══▶ P1 ══pass══▶ P2 ══pass══▶ … ══pass══▶ Pk ══push══▶ B

and each arrow is possible by itself in some setting of the rotary valves and solenoids; between two
arrows the liquid rests in a syringe and the valves may turn. *Possible* means: in that setting the
tubes that are joined to the syringe lead to the one vessel or syringe of the arrow, and nowhere
else. Every hose is a link of the right type, walked in a direction in which it carries liquid. Only
rotary valves and solenoids are passed; vessels, cartridges, manifolds, gas and vacuum never.

What follows for the place of the pump ("a path … with a pump on it"):

* Pump at the common port: `A ─ 1 V c ─ P` and `B ─ 2 V c`. Draw on 1, push on 2: feasible. The path
  A ─ V ─ B itself does not contain P; what counts is that P is joined to both, one after the other.
* Outer to outer: `A ─ 1 V 2 ─ B`, pump nowhere: a rotary valve never joins 1 with 2. Infeasible,
  and also when the pump is on 3: it is joined to nothing but c.
* Pump on an outer port: `P ─ 1 V c ─ A`: P reaches A alone. A gives and takes, to no other vessel.
* Backbone: `A ─ 2 V1 c ─ P1`, `V1 1 ─ 2 V2`, `V2 c ─ P2`, `V2 3 ─ B`. V1 on 1 and V2 on 2 join P1
  with P2: pass, then push. A valve without a pump between two such valves is passed only from its
  common port to an outer one, so `V1 1 ─ 2 V2 1 ─ 2 V3` with V2's pump missing is a break.
* Passive valve: `P ─ c V1 3 ─ c V2 1 ─ A` and `V2 2 ─ B` is feasible with the one pump: V2 turns.
* Pump in line: `A ─ S1 ─ P ─ S2 ─ B` with solenoids is feasible, one open at a time. Without them,
  or with one alone, P is joined to A and B at once: infeasible. Between two rotary valves it is
  feasible if each can be turned where its hose ends shut; a port without a hose is open to the
  air and shuts nothing.
* Many hoses on a pump without a valve: joined to all of them at once: infeasible.
* A pump with a valve built in is a pump at the common port of its own valve.
* A vessel on the path, `A ─ V ─ C ─ V ─ B`, breaks it.

Three answers, since a graph does not say everything. **Open** is a pair for which both a right
plan and a refusal are accepted: the file has a fault of its own (duplicate ids, valve ports that do
not exist or carry hoses to two devices), or every way needs a syringe at rest to shut a hose, or
needs a one-way edge to shut one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

from tests.judge.flow import Sense
from tests.judge.request import Request
from tests.judge.rig import Kind, Rig
from tests.judge.ways import Setting, Way, find_ways


class Answer(StrEnum):
    """What the definition says."""

    FEASIBLE = "feasible"
    OPEN = "open"
    INFEASIBLE = "infeasible"


@dataclass(frozen=True)
class Leg:
    """One arrow: a syringe, what it is joined to, and in which setting."""

    pump: str
    setting: Setting
    is_sure: bool
    other: str = ""
    """The syringe or vessel at the other end."""
    ports: frozenset[str] = frozenset()
    """The vessel's ports that are joined."""


@dataclass(frozen=True)
class Finding:
    """The answer for one request."""

    answer: Answer
    why: str = ""
    legs: tuple[Leg, ...] = ()
    """Draw, passes, push: a way to do it."""
    break_ids: frozenset[str] = frozenset()
    """Devices of which a refusal may name one as the place where the path breaks."""


class Oracle:
    """Feasibility on one rig; the ways are searched once."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self._known: dict[Request, Finding] = {}

    @cached_property
    def tubes(self) -> Rig:
        """The same rig, every hose carrying liquid both ways."""
        hoses = (replace(hose, is_forward=True, is_backward=True) for hose in self.rig.hoses)
        return Rig(self.rig.devices, tuple(hoses), self.rig.dry, self.rig.faults)

    @cached_property
    def draws(self) -> dict[str, list[Leg]]:
        """From which vessels a syringe can draw, by syringe."""
        return {pump: self._vessel_legs(pump, Sense.DRAW) for pump in self.rig.pumps()}

    @cached_property
    def pushes(self) -> dict[str, list[Leg]]:
        """Into which vessels a syringe can push, by syringe."""
        return {pump: self._vessel_legs(pump, Sense.PUSH) for pump in self.rig.pumps()}

    @cached_property
    def passes(self) -> dict[str, list[Leg]]:
        """To which syringes a syringe can pass, by syringe."""
        return {pump: list(self._pass_legs(pump)) for pump in self.rig.pumps()}

    def _vessel_legs(self, pump: str, sense: Sense) -> list[Leg]:
        legs: dict[tuple[str, frozenset[str]], Leg] = {}
        for way in find_ways(self.rig, pump, sense):
            names = {name for name, _ in way.vessels}
            if len(names) != 1:
                continue
            vessel, ports = names.pop(), frozenset(port for _, port in way.vessels)
            is_sure = way.is_sure and not way.pumps
            old = legs.get((vessel, ports))
            if old is None or (is_sure and not old.is_sure):
                legs[(vessel, ports)] = Leg(pump, way.setting, is_sure, vessel, ports)
        return list(legs.values())

    def _pass_legs(self, pump: str) -> Iterator[Leg]:
        known = set(self.rig.pumps())
        for way in find_ways(self.rig, pump, Sense.PUSH):
            if way.vessels:
                continue
            for partner in sorted(way.pumps & known):
                back = self._way_back(partner, pump, way)
                if back is not None:
                    sure = way.is_sure and back.is_sure and way.pumps == {partner}
                    is_sure = sure and back.pumps == {pump}
                    yield Leg(pump, back.setting, is_sure, partner)

    def _way_back(self, partner: str, pump: str, way: Way) -> Way | None:
        back = find_ways(self.rig, partner, Sense.DRAW, way.setting)
        fits = [one for one in back if pump in one.pumps and not one.vessels]
        return next((one for one in fits if one.is_sure), fits[0] if fits else None)

    def ask(self, request: Request) -> Finding:
        """Answer for a request; the volume makes no difference."""
        ends = replace(request, volume_nl=1)
        if ends not in self._known:
            self._known[ends] = self._answer(ends)
        return self._known[ends]

    def _answer(self, request: Request) -> Finding:
        wrong = self._wrong_ends(request)
        if wrong is not None:
            return wrong
        legs = self._chain(request, only_sure=True)
        if legs is not None and not self.rig.faults:
            return Finding(Answer.FEASIBLE, legs=legs)
        legs = legs or self._chain(request, only_sure=False)
        if legs is not None:
            why = "; ".join(self.rig.faults) or "something else has to shut a hose"
            return Finding(Answer.OPEN, why, legs)
        return Finding(Answer.INFEASIBLE, "no chain of syringes", break_ids=self._breaks(request))

    def _wrong_ends(self, request: Request) -> Finding | None:
        for name in (request.source, request.target):
            device = self.rig.devices.get(name)
            if device is None or device.kind is not Kind.VESSEL:
                return Finding(Answer.INFEASIBLE, f"{name} is no vessel", (), frozenset({name}))
        if request.source == request.target:
            names = frozenset({request.source})
            return Finding(Answer.INFEASIBLE, "source and target are one", (), names)
        return None

    def _chain(self, request: Request, *, only_sure: bool) -> tuple[Leg, ...] | None:
        """Return the chain with the fewest syringes."""
        ready: list[tuple[Leg, ...]] = [
            (leg,)
            for legs in self.draws.values()
            for leg in legs
            if _fits(leg, request.source, request.from_port, only_sure=only_sure)
        ]
        seen = {chain[0].pump for chain in ready}
        while ready:
            chain = ready.pop(0)
            pump = chain[-1].pump if len(chain) == 1 else chain[-1].other
            for leg in self.pushes[pump]:
                if _fits(leg, request.target, request.to_port, only_sure=only_sure):
                    return (*chain, leg)
            for leg in self.passes[pump]:
                if leg.other not in seen and (leg.is_sure or not only_sure):
                    seen.add(leg.other)
                    ready.append((*chain, leg))
        return None

    def _breaks(self, request: Request) -> frozenset[str]:
        """Name both sides of every gap: what is reached, and what lies next to it unreached.

        A vessel that no syringe joins by the port that was asked for is a gap by itself. Where no
        syringe can move what some setting of valves and solenoids leads to it, what is led there is
        reached too: the way may break at a syringe that is open to several things, or at a valve.
        """
        ahead = self._region(request.source, self.draws, self.pushes, forward=True)
        behind = self._region(request.target, self.pushes, self.draws, forward=False)
        portless = {
            vessel
            for vessel, port, legs in (
                (request.source, request.from_port, self.draws),
                (request.target, request.to_port, self.pushes),
            )
            if port is not None and not self._joins(legs, vessel, port)
        }
        edges = self._edge(ahead, request.source) | self._edge(behind, request.target)
        led = self._led_to(request.source) | self._led_to(request.target)
        return frozenset(portless | edges | led)

    def _joins(self, legs: dict[str, list[Leg]], vessel: str, port: str) -> bool:
        return any(
            _fits(leg, vessel, port, only_sure=False) for own in legs.values() for leg in own
        )

    def _led_to(self, vessel: str) -> set[str]:
        """Name all that some setting of valves and solenoids leads a vessel's hoses to."""
        waiting = [
            hose.other(end) for end in self.rig.ends_of(vessel) for hose in self.rig.hoses_at(end)
        ]
        met = set(waiting)
        while waiting:
            name, port = waiting.pop()
            device = self.rig.devices[name]
            if device.kind not in (Kind.VALVE, Kind.SOLENOID):
                continue
            for end in self.rig.ends_of(name):
                is_joined = device.kind is Kind.SOLENOID or device.common in (port, end[1])
                if end[1] == port or not is_joined:
                    continue
                further = {hose.other(end) for hose in self.rig.hoses_at(end)} - met
                met |= further
                waiting += further
        return {name for name, _ in met}

    def _edge(self, region: set[str], vessel: str) -> set[str]:
        """Name the devices on both sides of a region's border; of an island, all but the vessel."""
        edge: set[str] = set()
        is_island = True
        for name in region:
            outside = set(self.rig.neighbours(name)) - region
            edge |= outside | ({name} if outside else set())
            wet = {
                hose.other(end)[0]
                for end in self.rig.ends_of(name)
                for hose in self.rig.hoses_at(end)
            }
            is_island = is_island and wet <= region
        if is_island:
            edge |= region - {vessel}
        return edge or {vessel}

    def _region(
        self,
        vessel: str,
        first: dict[str, list[Leg]],
        last: dict[str, list[Leg]],
        *,
        forward: bool,
    ) -> set[str]:
        pumps = {pump for pump, legs in first.items() if any(leg.other == vessel for leg in legs)}
        region, waiting = {vessel}, list(pumps)
        steps = [(a, leg.other) for a, legs in self.passes.items() for leg in legs]
        while waiting:
            pump = waiting.pop()
            region |= {pump} | {leg.other for leg in last[pump]}
            for leg in (*first[pump], *last[pump], *self.passes[pump]):
                region |= set(dict(leg.setting.positions)) | set(leg.setting.opened)
            for start, end in steps:
                here, there = (start, end) if forward else (end, start)
                if here == pump and there not in pumps:
                    pumps.add(there)
                    waiting.append(there)
        return region


def _fits(leg: Leg, vessel: str, port: str | None, *, only_sure: bool) -> bool:
    is_wanted = leg.other == vessel and (leg.is_sure or not only_sure)
    return is_wanted and (port is None or leg.ports == {port})
