"""Runs a plan on a graph as its file says it, with no code of the compiler.

It knows four things: a valve joins its common port to the port it was turned to, a plunger
moves liquid along what is joined at that moment, a link of a Chemputer graph conducts as it is
drawn, and a link of any other graph conducts both ways.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

Port = tuple[str, str]
DRY = ("stirrer", "heatchill", "sensor")
CLOSE = 0.002
"""Microlitres that sums of floats may be off."""


class WrongError(AssertionError):
    """The plan does something that it must not."""


def ports_of(link: dict[str, Any]) -> tuple[str, str]:
    port = link.get("port")
    if isinstance(port, dict):
        return str(port[link["source"]]).strip(), str(port[link["target"]]).strip()
    first, _, second = str(port).strip("()").partition(",")
    return first.strip(), second.strip()


class Plumbing:
    """What a graph's file says, once for all plans."""

    def __init__(self, graph: dict[str, Any]) -> None:
        self.sort = {str(n["id"]): self._sort(n) for n in graph["nodes"]}
        self.common = {key: "-1" for key, sort in self.sort.items() if sort == "valve"}
        self.size_ul = {
            str(n["id"]): 1000 * float((n.get("config") or n).get("max_volume") or 0)
            for n in graph["nodes"]
            if self.sort[str(n["id"])] == "pump"
        }
        self.flows: dict[Port, set[Port]] = defaultdict(set)
        self.back: dict[Port, set[Port]] = defaultdict(set)
        for link in graph["links"]:
            if link.get("type") in ("fluid", "physical"):
                self._join(link, both=True)
            elif link.get("type") is None:
                self._join(link, both=False)

    @staticmethod
    def _sort(node: dict[str, Any]) -> str:
        words = f"{node.get('class') or ''}".lower() or str(node.get("type"))
        for word in ("solenoid", "valve", "vacuum", *DRY):
            if word in words:
                return word
        return "pump" if "pump" in words else "end"

    def _join(self, link: dict[str, Any], *, both: bool) -> None:
        ends = [str(link["source"]), str(link["target"])]
        if any(self.sort[end] in DRY for end in ends):
            return
        names = ports_of(link)
        if both:
            for end, name, far in (
                (ends[0], names[0], ends[1]),
                (ends[1], names[1], ends[0]),
            ):
                is_common = self.sort[far] == "pump" or name == "transferpump"
                if self.sort[end] == "valve" and is_common:
                    self.common[end] = name
        one, two = (ends[0], names[0]), (ends[1], names[1])
        for tail, head in ((one, two), (two, one)) if both else ((one, two),):
            self.flows[tail].add(head)
            self.back[head].add(tail)


class World:
    """Where everything stands and what it holds, while a plan runs."""

    def __init__(self, plumbing: Plumbing, source: str, amount_ul: float) -> None:
        self.sort, self.common = plumbing.sort, plumbing.common
        self.size_ul, self.flows, self.back = plumbing.size_ul, plumbing.flows, plumbing.back
        self.at: dict[str, str] = {}
        self.opened: set[str] = set()
        self.holds: dict[str, float] = defaultdict(float)
        self.holds[source] = 2 * amount_ul

    def trace(self, start: str, joined: dict[Port, set[Port]]) -> set[str]:
        """Return where liquid gets to from a pump, along `joined`."""
        found: set[str] = set()
        waiting = [port for port in joined if port[0] == start]
        seen = set(waiting)
        while waiting:
            for far in joined[waiting.pop()]:
                if far in seen:
                    continue
                seen.add(far)
                if self.sort[far[0]] in ("valve", "solenoid"):
                    onward = set(self._across(far, joined)) - seen
                    seen |= onward
                    waiting += onward
                else:
                    found.add(far[0])
        return found

    def _across(self, port: Port, joined: dict[Port, set[Port]]) -> Iterator[Port]:
        key, name = port
        if self.sort[key] == "solenoid":
            if key in self.opened:
                yield from (p for p in joined if p[0] == key and p != port)
            return
        common, turned = self.common[key], self.at.get(key)
        if turned is not None and name in (common, turned):
            yield (key, turned if name == common else common)

    def run(self, steps: list[list[dict[str, Any]]]) -> None:
        for group in steps:
            devices = [command["device"] for command in group]
            if len(devices) != len(set(devices)):
                raise WrongError(f"one device is told two things at once: {group}")
            moves = {c["device"]: c for c in group if c["action"] in ("aspirate", "dispense")}
            if moves and len(moves) != len(group):
                raise WrongError("a valve is turned while a plunger moves")
            for command in group:
                self._set(command)
            self._move(moves)

    def _set(self, command: dict[str, Any]) -> None:
        key, action = command["device"], command["action"]
        if action == "set_port":
            port = command["parameters"]["port"]
            if self.sort[key] != "valve" or not isinstance(port, str) or port == self.common[key]:
                raise WrongError(f"cannot be turned so: {command}")
            if not any((key, port) in joined for joined in (self.flows, self.back)):
                raise WrongError(f"no tube at that port: {command}")
            self.at[key] = port
        elif action == "open":
            self.opened.add(key)
        elif action == "close":
            self.opened.remove(key)

    def _move(self, moves: dict[str, dict[str, Any]]) -> None:
        for key, command in moves.items():
            amount = command["parameters"]["volume_ul"]
            rate = command["parameters"]["rate_ul_s"]
            if not amount > 0 or not rate > 0:
                raise WrongError(f"no amount or no rate: {command}")
            draws = command["action"] == "aspirate"
            others = self.trace(key, self.back if draws else self.flows)
            if len(others) != 1:
                raise WrongError(
                    f"{command} {'draws from' if draws else 'reaches'} {sorted(others)}"
                )
            other = others.pop()
            if self.sort[other] == "pump":
                twin = moves.get(other)
                wanted = "dispense" if draws else "aspirate"
                same = twin is not None and twin["parameters"] == command["parameters"]
                if twin is None or twin["action"] != wanted or not same:
                    raise WrongError(f"{command}, and {other} does not take part")
            elif self.sort[other] != "end":
                raise WrongError(f"{command} ends at {other}")
            sign = 1 if draws else -1
            self.holds[key] += sign * amount
            if self.sort[other] != "pump":
                self.holds[other] -= sign * amount
            if not -CLOSE < self.holds[key] <= self.size_ul[key] + CLOSE:
                raise WrongError(f"{key} holds {self.holds[key]} of {self.size_ul[key]}")
            if self.holds[other] < -CLOSE:
                raise WrongError(f"{other} is drawn dry")


def check(
    plumbing: Plumbing, steps: list[list[dict[str, Any]]], source: str, target: str, ul: float
) -> None:
    """Run a plan and see that the amount, and nothing else, went from source to target."""
    world = World(plumbing, source, ul)
    world.run(steps)
    if world.opened:
        raise WrongError(f"left open: {world.opened}")
    for key, amount in world.holds.items():
        expected = {source: ul, target: ul}.get(key, 0.0)
        if abs(amount - expected) > CLOSE:
            raise WrongError(f"{key} holds {amount}, not {expected}")
