"""Valid labs by seed: names, plumbing, ports, addresses, lines and capacities shuffled."""

from __future__ import annotations

import itertools
import json
import random
from typing import Any

_WORDS = ("Amber", "Blau", "Cobalt", "Dorée", "Ebony", "Fuchsia", "Grün", "Henna", "Indigo", "Jade")
_SYRINGES_UL = (500, 1000, 2500, 5000, 12500)
_CAPACITIES_UL = (20_000, 50_000, 100_000, 250_000, 1_000_000)
_ADDRESSES = "123456789"


def generated_lab(seed: int) -> bytes:
    """Return the lab.json of a seed; the same seed gives the same bytes.

    Every vessel hangs on at least one pump. Pumps form one chain of valves, or stand alone;
    names and keys say nothing about what a thing is, so that nothing can be guessed from them.

    ```text
    vessels ── valve ──(sometimes)── valve ── vessels
                 │                     │
               pump                  pump        on one or several RS-485 lines
    ```
    """
    return json.dumps(_Generator(seed).lab(), ensure_ascii=False, indent=1).encode()


class _Generator:
    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.random = random.Random(seed)
        self.keys = [f"n{number:03d}" for number in range(100, 200)]
        self.random.shuffle(self.keys)
        self.connections: list[dict[str, Any]] = []
        self.resources: list[dict[str, Any]] = []

    def lab(self) -> dict[str, Any]:
        root = self._place("lab", None)
        bench = self._place("bench", root)
        self._place("archive", root)
        vessels = [self._vessel(bench, index) for index in range(self.random.randint(2, 8))]
        pumps = [self._pump(bench) for _ in range(self.random.randint(1, 4))]
        self._chain(pumps)
        self._plumb(pumps, vessels)
        materials, lots = self._fill(vessels)
        timer = self._add("timer", bench, {})
        self.random.shuffle(self.resources)
        self.random.shuffle(self.connections)
        devices = [*self._pump_devices(pumps), self._timer(timer)]
        self.random.shuffle(devices)
        return {
            "schema": "labweb.lab/1",
            "name": f"Generated lab {self.seed}",
            "time_zone": self.random.choice(("UTC", "Europe/Berlin", "Asia/Shanghai")),
            "mode": "sim",
            "materials": materials,
            "lots": lots,
            "resources": self.resources,
            "connections": self.connections,
            "hosts": [{"key": "host", "name": "Host"}],
            "devices": devices,
        }

    def _name(self) -> str:
        return f"{self.random.choice(_WORDS)} {self.random.randint(10, 99)} {self.keys[-1]}"

    def _add(self, kind: str, parent: str | None, config: dict[str, Any]) -> str:
        name, key = self._name(), self.keys.pop()
        entry = {"key": key, "name": name, "kind": kind, "parent": parent, "config": config}
        self.resources.append(entry)
        return key

    def _place(self, kind: str, parent: str | None) -> str:
        return self._add(kind, parent, {})

    def _vessel(self, bench: str, index: int) -> str:
        # The first two can always serve as source and target of a transfer.
        kind = "waste" if index == 2 else self.random.choice(("bottle", "flask", "vessel", "vial"))
        config: dict[str, Any] = {"capacity_ul": self.random.choice(_CAPACITIES_UL)}
        if self.random.random() < 0.5:
            config["dead_volume_ul"] = self.random.randint(0, 500)
        config["tare_mg"] = self.random.randint(5_000, 300_000)
        return self._add(kind, bench, config)

    def _pump(self, bench: str) -> dict[str, Any]:
        ports_count = self.random.choice((9, 10, 12))
        syringe_ul = self.random.choice(_SYRINGES_UL)
        common = self.random.choice(("common", "c", "transferpump"))
        pump = self._add("syringe_pump", bench, {"capacity_ul": syringe_ul})
        valve = self._add(
            "rotary_valve", bench, {"ports_count": ports_count, "common_port": common}
        )
        ports = [str(number) for number in range(1, ports_count + 1)]
        self.random.shuffle(ports)
        self._connect((pump, "outlet"), (valve, common))
        return {
            "pump": pump,
            "valve": valve,
            "ports": ports,
            "ports_count": ports_count,
            "syringe_ul": syringe_ul,
        }

    def _connect(self, source: tuple[str, str], target: tuple[str, str]) -> None:
        if self.random.random() < 0.5:
            source, target = target, source
        dead_volume_ul = self.random.choice((None, self.random.randint(0, 400), 12.5))
        self.connections.append(
            {
                "key": f"t{len(self.connections):03d}",
                "source": {"resource": source[0], "port": source[1]},
                "target": {"resource": target[0], "port": target[1]},
                "medium": "liquid",
                "is_two_way": True,
                "dead_volume_ul": dead_volume_ul,
            }
        )

    def _chain(self, pumps: list[dict[str, Any]]) -> None:
        for one, other in itertools.pairwise(pumps):
            if self.random.random() < 0.6:
                ends = [(pump["valve"], pump["ports"].pop()) for pump in (one, other)]
                self._connect(ends[0], ends[1])

    def _plumb(self, pumps: list[dict[str, Any]], vessels: list[str]) -> None:
        for index, vessel in enumerate(vessels):
            able = [pump for pump in pumps if pump["ports"]]
            chosen = [pumps[0]] if index < 2 and pumps[0]["ports"] else [self.random.choice(able)]
            chosen += [p for p in able if p not in chosen and self.random.random() < 0.25]
            for number, pump in enumerate(chosen):
                if pump["ports"]:
                    self._connect((pump["valve"], pump["ports"].pop()), (vessel, f"neck {number}"))

    def _fill(self, vessels: list[str]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        materials, lots = [], []
        by_key = {entry["key"]: entry for entry in self.resources}
        for index, vessel in enumerate(vessels):
            entry = by_key[vessel]
            if entry["kind"] == "waste" or (index and self.random.random() < 0.4):
                continue
            material: dict[str, Any] = {"key": f"m{index}", "name": f"Liquid {index}"}
            if self.random.random() < 0.8:
                material["density_mg_ul"] = self.random.randint(700, 1500) / 1000
                material["ph"] = self.random.randint(10, 130) / 10
            materials.append(material)
            lots.append({"key": f"l{index}", "material": material["key"]})
            amount_ul = int(entry["config"]["capacity_ul"] * self.random.uniform(0.3, 0.8))
            entry["contents"] = [{"lot": f"l{index}", "amount_ul": amount_ul}]
        return materials, lots

    def _pump_devices(self, pumps: list[dict[str, Any]]) -> list[dict[str, Any]]:
        lines_count = self.random.randint(1, len(pumps))
        addresses = self.random.sample(_ADDRESSES, len(pumps))
        devices = []
        for index, (pump, address) in enumerate(zip(pumps, addresses, strict=True)):
            shared = {"address": address, "syringe_ul": pump["syringe_ul"]}
            devices.append(
                {
                    "key": f"d{self.keys.pop()}",
                    "name": self._name(),
                    "host": "host",
                    "driver": "drivers.connectors.tricontinent_c3000:TricontinentC3000",
                    "config": {**shared, "ports_count": pump["ports_count"]},
                    "nodes": {"pump": pump["pump"], "valve": pump["valve"]},
                    "transport": None,
                    "simulator": {
                        "model": "tricontinent_c3000",
                        "settings": {**shared, "ports": pump["ports_count"]},
                        "line": f"line {index % lines_count}",
                    },
                }
            )
        return devices

    def _timer(self, timer: str) -> dict[str, Any]:
        return {
            "key": f"d{self.keys.pop()}",
            "name": self._name(),
            "host": "host",
            "driver": "drivers.virtual.timer:HostTimer",
            "config": {},
            "nodes": {"timer": timer},
            "transport": None,
            "simulator": {"model": "timer"},
        }


def lab_of_pumps(count: int, *, lines_count: int) -> bytes:
    """Return the lab.json of so many syringe pumps, each with a bottle, a flask and a valve.

    ```text
    bottle ── valve ── flask      no pump can reach what another has
                │
              pump                dealt out over the RS-485 lines, one address each
    ```
    """
    places = [("lab", None), ("bench", "lab"), ("archive", "lab")]
    resources: list[dict[str, Any]] = [
        {"key": key, "name": key.title(), "kind": key, "parent": parent, "config": {}}
        for key, parent in places
    ]
    lab: dict[str, Any] = {
        "schema": "labweb.lab/1",
        "name": f"{count} pumps",
        "time_zone": "UTC",
        "mode": "sim",
        "materials": [{"key": "water", "name": "Water", "density_mg_ul": 0.9978, "ph": 7.0}],
        "lots": [{"key": "water_lot", "material": "water"}],
        "resources": resources,
        "connections": [],
        "hosts": [{"key": "host", "name": "Host"}],
        "devices": [],
    }
    for number in range(count):
        _add_station(lab, number, f"line {number % lines_count}", str(number // lines_count + 1))
    return json.dumps(lab).encode()


def _add_station(lab: dict[str, Any], number: int, line: str, address: str) -> None:
    water = [{"lot": "water_lot", "amount_ul": 200_000}]
    glass = {"capacity_ul": 250_000, "tare_mg": 100_000}
    rows: dict[str, tuple[str, dict[str, Any], list[dict[str, Any]]]] = {
        "pump": ("syringe_pump", {"capacity_ul": 1000}, []),
        "valve": ("rotary_valve", {"ports_count": 9, "common_port": "common"}, []),
        "bottle": ("bottle", glass, water),
        "flask": ("flask", glass, []),
    }
    for name, (kind, config, contents) in rows.items():
        resource: dict[str, Any] = {
            "key": f"{name}_{number}",
            "name": f"{name.title()} {number}",
            "kind": kind,
        }
        resource |= {"parent": "bench", "config": config}
        lab["resources"].append(resource | ({"contents": contents} if contents else {}))
    ends = [("pump", "outlet", "common"), ("bottle", "neck", "2"), ("flask", "neck", "5")]
    for name, port, of_valve in ends:
        source = {"resource": f"{name}_{number}", "port": port}
        target = {"resource": f"valve_{number}", "port": of_valve}
        tube = {"source": source, "target": target, "medium": "liquid", "is_two_way": True}
        lab["connections"].append({"key": f"{name}_{number}_tube", **tube, "dead_volume_ul": 10})
    shared = {"address": address, "syringe_ul": 1000}
    lab["devices"].append(
        {
            "key": f"pump_{number}",
            "name": f"Pump {number}",
            "host": "host",
            "driver": "drivers.connectors.tricontinent_c3000:TricontinentC3000",
            "config": {**shared, "ports_count": 9},
            "nodes": {"pump": f"pump_{number}", "valve": f"valve_{number}"},
            "transport": None,
            "simulator": {
                "model": "tricontinent_c3000",
                "settings": {**shared, "ports": 9},
                "line": line,
            },
        }
    )
