"""Random stations: rings, solenoids, shared ports, valves that pumps do not reach."""

from __future__ import annotations

import json
import random
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.recipes.transfers_on_rig import compile_line
from tests.domain.recipes.interpreter import Plumbing, check
from tests.domain.recipes.rigs import rig_of

End = tuple[str, str]


class Station:
    """A station of multiway valves, drawn by chance."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.nodes: list[dict[str, Any]] = []
        self.tubes: list[tuple[End, End]] = []
        self.vessels: list[str] = []
        count = self.chance.randint(1, 7)
        self.free = {n: [str(port) for port in range(1, 9)] for n in range(count)}
        for number in range(count):
            self.chance.shuffle(self.free[number])
            self.add_valve(number)
        for _ in range(count + self.chance.randint(0, 3)):
            self.join_valves(*(self.chance.randrange(count) for _ in range(2)))
        for number in range(self.chance.randint(2, 8)):
            self.add_vessel(number, self.chance.randrange(count))

    def node(self, key: str, word: str, type_: str = "device", **config: float) -> str:
        self.nodes.append({"id": key, "class": word, "type": type_, "config": config})
        return key

    def tube(self, one: End, two: End, *, gated: float) -> None:
        if self.chance.random() < gated:
            gate = self.node(f"gate_{len(self.nodes)}", "virtual_solenoid_valve")
            self.tubes += [(one, (gate, "in")), ((gate, "out"), two)]
        else:
            self.tubes.append((one, two))

    def add_valve(self, number: int) -> None:
        key = self.node(f"valve_{number}", "virtual_multiway_valve")
        common = (key, "transferpump")
        if self.chance.random() < 0.75:
            size = self.chance.choice((5.0, 10.0, 25.0))
            pump = self.node(f"pump_{number}", "virtual_transfer_pump", max_volume=size)
            self.tube((pump, "transferpump"), common, gated=0.15)
        elif number and self.chance.random() < 0.7:
            other = self.chance.randrange(number)
            self.tubes.append((common, (f"valve_{other}", self.free[other].pop())))

    def join_valves(self, one: int, two: int) -> None:
        if one != two and self.free[one] and self.free[two]:
            ends = [(f"valve_{n}", self.free[n].pop()) for n in (one, two)]
            self.tube(ends[0], ends[1], gated=0.2)

    def add_vessel(self, number: int, valve: int) -> None:
        if not self.free[valve]:
            return
        # Now and then at a port that is taken: the flow divides there.
        is_own = self.chance.random() < 0.93
        port = self.free[valve].pop() if is_own else self.chance.choice("12345678")
        key = self.node(f"flask_{number}", "", "container", max_volume=100.0)
        self.vessels.append(key)
        self.tube((f"valve_{valve}", port), (key, self.chance.choice(("top", "bottom"))), gated=0.1)

    def graph(self) -> dict[str, Any]:
        self.chance.shuffle(self.tubes)
        links = []
        for place, ends in enumerate(self.tubes):
            (one, a), (two, b) = ends if self.chance.random() < 0.5 else ends[::-1]
            links.append(
                {"id": f"link_{place}", "source": one, "target": two, "port": {one: a, two: b}}
                | {"type": self.chance.choice(("fluid", "physical"))}
            )
        return {"nodes": self.nodes, "links": links}


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**9), ml=st.sampled_from((0.1, 10.0, 60.0)))
def test_every_plan_on_a_random_station_moves_the_amount_and_nothing_else(
    seed: int, ml: float
) -> None:
    station = Station(seed)
    graph = station.graph()
    rig, plumbing = rig_of(graph), Plumbing(graph)
    for source in station.vessels:
        for target in station.vessels:
            line = json.dumps({"from": source, "to": target, "volume": f"{ml} mL"}).encode()
            answer = compile_line(rig, line)
            if answer["ok"]:
                check(plumbing, answer["steps"], source, target, ml * 1000)
            else:
                (first, *_) = answer["findings"]
                assert first["code"].startswith("plan.")
                assert "fits what is asked" not in first["message"]
