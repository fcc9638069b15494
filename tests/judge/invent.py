"""Invent a rig and requests from a seed: plumbing that nobody drew with a compiler in mind.

Backbones of one to six valves, in chains, trees and rings, with and without a pump on each; valves
that only pass on; syringes with a valve built in, syringes in line between solenoids, syringes with
many bare hoses; vessels on two valves or none, hoses from vessel to vessel; gas, vacuum, columns
and cartridges on valve ports; serial buses that touch every device; edges drawn twice; names that
lie about what a thing is.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path

from tests.judge.draft import VESSELS, Draft
from tests.judge.harness import Line

_SUFFIX = {"unilab": ".json", "json": ".json", "graphml": ".graphml", "yed": ".graphml"}
_SYRINGES_ML = (1.0, 2.5, 5.0, 10.0, 12.5, 25.0, 50.0)
_PORTS = {
    "chemputer": ("-1", tuple("012345")),
    "numbers": ("transferpump", tuple("12345678")),
    "long": (
        "multiway-valve-inlet",
        tuple(f"multiway-valve-port-{number}" for number in range(1, 9)),
    ),
}
_VESSEL_PORTS = {
    "separator": ("top", "bottom"),
    "filter": ("top", "bottom"),
    "rotavap": ("evaporate", "collect"),
    "reactor": ("0", "1", "2"),
    "flask": ("0",),
    "waste": ("0",),
}
_BAD_VOLUMES = ("two drops", "-5 mL", "0 mL", "", "10")


@dataclass(frozen=True)
class Invented:
    """A graph file and what to ask of it."""

    seed: int
    form: str
    text: str
    lines: list[Line]

    def write(self, folder: Path) -> Path:
        """Write the graph and return its path."""
        path = folder / f"rig_{self.seed}_{self.form}{_SUFFIX[self.form]}"
        path.write_text(self.text, "utf-8")
        return path


def invent(seed: int, most_lines: int = 60) -> Invented:
    """Return the rig of a seed."""
    dice = random.Random(f"rig {seed}")
    form = dice.choices(("unilab", "json", "graphml", "yed"), (6, 3, 1, 1))[0]
    return Invented(seed, form, *_invent(dice, form, most_lines))


def same_rig_in_three_forms(seed: int) -> dict[str, str]:
    """Return one rig of the Chemputer's in each form of file."""
    forms = ("json", "graphml", "yed")
    return {form: _invent(random.Random(f"rig {seed}"), form, 0)[0] for form in forms}


def _invent(dice: random.Random, form: str, most_lines: int) -> tuple[str, list[Line]]:
    plumber = _Plumber(dice, is_chemputer=form != "unilab")
    plumber.plumb()
    draft = plumber.draft
    ports = {(link.a, link.a_port) for link in draft.links} | {
        (link.b, link.b_port) for link in draft.links
    }
    lines = _requests(dice, draft, ports, most_lines)
    return draft.text(form), lines


class _Plumber:
    def __init__(self, dice: random.Random, *, is_chemputer: bool) -> None:
        self.dice, self.is_chemputer = dice, is_chemputer
        self.draft = Draft(dice, is_chemputer)
        self.free: dict[str, list[str]] = {}
        """Outer ports without a hose, by valve."""
        self.common: dict[str, str] = {}
        self.tips: list[tuple[str, str]] = []

    def plumb(self) -> None:
        for _ in range(self.dice.choice((1, 1, 1, 2, 3))):
            self._backbone()
        for _ in range(self.dice.choice((0, 0, 1))):
            self._bare_pump()
        if not self.is_chemputer and self.dice.random() < 0.4:
            self._pump_in_line()
        self._vessels()
        self._dead_ends()
        self._distract()

    def _pump(self, role: str = "pump") -> str:
        return self.draft.add(role, self.dice.choice(_SYRINGES_ML))

    def _valve(self) -> str:
        if not self.is_chemputer and self.dice.random() < 0.2:
            valve = self._pump("pump_valve")
            self.free[valve] = list("12345678")
            self.dice.shuffle(self.free[valve])
            return valve
        style = "chemputer" if self.is_chemputer else self.dice.choice(("numbers", "long"))
        valve = self.draft.add("valve", style=style)
        common, ports = _PORTS[style]
        self.common[valve], self.free[valve] = common, list(ports)
        self.dice.shuffle(self.free[valve])
        return valve

    def _backbone(self) -> None:
        valves: list[str] = []
        for _ in range(self.dice.choice((1, 2, 2, 3, 4, 6))):
            valve = self._valve()
            has_common = valve in self.common
            if valves:
                before = self.dice.choice(valves[-2:])
                self._tie(before, valve)
            if has_common and (valve, self.common[valve]) not in self._used():
                if self.dice.random() < 0.8:
                    self._tube((valve, self.common[valve]), (self._pump(), "0"))
                else:
                    self.tips.append((valve, self.common[valve]))
            valves.append(valve)
        if len(valves) > 2 and self.dice.random() < 0.4:
            self._tie(valves[-1], valves[0])
        if len(valves) > 1 and self.dice.random() < 0.2:
            self._tie(valves[0], valves[1])

    def _used(self) -> set[tuple[str, str]]:
        links = self.draft.links
        return {(link.a, link.a_port) for link in links} | {(link.b, link.b_port) for link in links}

    def _tie(self, before: str, after: str) -> None:
        """Join two valves by outer ports, or the first one's outer port with the other's common."""
        if not self.free[before] or not self.free[after]:
            return
        start = (before, self.free[before].pop())
        common = (after, self.common.get(after, ""))
        if common[1] and common not in self._used() and self.dice.random() < 0.15:
            self._tube(start, common)
        else:
            self._tube(start, (after, self.free[after].pop()))

    def _tube(self, a: tuple[str, str], b: tuple[str, str]) -> None:
        one_way = self.is_chemputer and self.dice.random() < 0.03
        self.draft.join(a, b, is_two_way=not one_way)
        if self.dice.random() < 0.05:
            self.draft.join(a, b, is_two_way=not one_way)

    def _bare_pump(self) -> None:
        pump = self._pump()
        for number in range(self.dice.choice((1, 2, 4))):
            vessel = self.draft.add("flask")
            port = self.dice.choice((str(number), "0"))
            self.draft.join((pump, port), (vessel, self._vessel_port("flask")))

    def _pump_in_line(self) -> None:
        pump = self._pump()
        for number in range(self.dice.choice((2, 2, 3))):
            vessel = self.draft.add("flask")
            if self.dice.random() < 0.85:
                solenoid = self.draft.add("solenoid")
                self.draft.join((pump, f"p{number}"), (solenoid, "in"))
                self.draft.join((solenoid, "out"), (vessel, self._vessel_port("flask")))
            else:
                self.draft.join((pump, f"p{number}"), (vessel, self._vessel_port("flask")))

    def _vessel_port(self, role: str) -> str:
        if self.is_chemputer or role in {"separator", "rotavap"}:
            return self.dice.choice(_VESSEL_PORTS[role])
        return self.dice.choice(("top", "inlet", "outlet", "0"))

    def _take_port(self) -> tuple[str, str] | None:
        valves = [name for name, ports in self.free.items() if ports]
        if not valves:
            return None
        valve = self.dice.choice(valves)
        return valve, self.free[valve].pop()

    def _vessels(self) -> None:
        for tip in self.tips:
            if tip not in self._used() and self.dice.random() < 0.5:
                self._attach(tip, *self._new_vessel())
        for _ in range(self.dice.randrange(3, 14)):
            vessel, role = self._new_vessel()
            for _ in range(self.dice.choices((0, 1, 2), (1, 10, 2))[0]):
                port = self._take_port()
                if port is not None:
                    self._attach(port, vessel, role)

    def _new_vessel(self) -> tuple[str, str]:
        role = self.dice.choice(("flask", "flask", "flask", *sorted(VESSELS)))
        return self.draft.add(role, 500.0), role

    def _attach(self, end: tuple[str, str], vessel: str, role: str) -> None:
        far = (vessel, self._vessel_port(role))
        if not self.is_chemputer and self.dice.random() < 0.12:
            solenoid = self.draft.add("solenoid")
            self.draft.join(end, (solenoid, "out"))
            end = (solenoid, "in")
        if self.is_chemputer and role == "flask" and self.dice.random() < 0.6:
            self.draft.join(far, end, is_two_way=False)
        elif self.is_chemputer and role == "waste" and self.dice.random() < 0.8:
            self.draft.join(end, far, is_two_way=False)
        else:
            self._tube(end, far)

    def _dead_ends(self) -> None:
        roles = ("vacuum", "cartridge") if self.is_chemputer else ("vacuum", "gas", "column")
        for _ in range(self.dice.randrange(3)):
            port = self._take_port()
            if port is not None:
                name = self.draft.add(self.dice.choice(roles))
                self.draft.join(port, (name, "0" if self.is_chemputer else "outlet"))
        vessels = self.draft.vessels()
        if len(vessels) > 1 and self.dice.random() < 0.3:
            a, b = self.dice.sample(vessels, 2)
            self.draft.join((a, "bottom"), (b, "top"))

    def _distract(self) -> None:
        names = [part.name for part in self.draft.parts]
        vessels = self.draft.vessels()
        stirrer = self.draft.add("stirrer")
        if self.is_chemputer:
            for vessel in self.dice.sample(vessels, min(2, len(vessels))):
                self.draft.join((stirrer, ""), (vessel, ""), is_two_way=False)
            return
        for vessel in self.dice.sample(vessels, min(2, len(vessels))):
            self.draft.join((stirrer, "head"), (vessel, "bind"), medium="mechanical")
        bus = self.draft.add("serial")
        for name in names:
            if self.dice.random() < 0.6:
                self.draft.join((bus, "bus"), (name, "serial"), medium="communication")
        port = self._take_port()
        if port is not None and vessels:
            self.draft.join(port, (self.dice.choice(vessels), "top"), medium="transport")


def _requests(
    dice: random.Random, draft: Draft, ports: set[tuple[str, str]], most: int
) -> list[Line]:
    vessels = draft.vessels()
    lines: list[Line] = []
    if len(vessels) < 2:
        return lines
    volumes = ("0.1 mL", "10 mL", "60 mL", "100 uL", "0.06 L", "7.3 mL", "12345 µL")
    for _ in range(most):
        a, b = dice.sample(sorted(vessels), 2)
        line: Line = {"from": a, "to": b, "volume": dice.choice(volumes)}
        for key, name in (("from_port", a), ("to_port", b)):
            own = sorted(port for device, port in ports if device == name and port)
            if own and dice.random() < 0.1:
                line[key] = dice.choice(own)
        lines.append(line)
    if lines:
        a = dice.choice(vessels)
        lines.append({"from": a, "to": a, "volume": "1 mL"})
        lines.append({"from": a, "to": "nobody", "volume": "1 mL"})
        b = dice.choice([name for name in vessels if name != a])
        lines.append({"from": a, "to": b, "volume": dice.choice(_BAD_VOLUMES)})
    return lines
