"""Transfers on published and large rigs: how many compile, and how long one takes.

`python -m benchmarks.transfers` prints every figure beside its limit, and the time of
`networkx.shortest_path` alone on the same graph when that package is installed (it is no
dependency of the project). `--counts FOLDER…` counts, on every graph below the folders, each
ordered pair of vessels × {0.1, 10, 60} mL.
"""

from __future__ import annotations

import argparse
import gzip
import importlib
import json
import random
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from labweb.domain.errors import LabFileError
from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.transfers_on_rig import compile_line

LIMITS_MS = {"35 nodes": 1.0, "1000 valves": 10.0}
VOLUMES = ("0.1 mL", "10 mL", "60 mL")
_VALVES = {"35 nodes": 6, "1000 valves": 1000}


def backbone(valves: int) -> dict[str, Any]:
    """Draw a backbone as the published rigs have it: each valve with a pump, waste and flasks."""
    nodes: list[dict[str, Any]] = []
    links: list[dict[str, Any]] = []

    def join(one: str, two: str, ports: tuple[int, int], *, both: bool) -> None:
        links.append({"source": one, "target": two, "port": f"({ports[0]},{ports[1]})"})
        if both:
            links.append({"source": two, "target": one, "port": f"({ports[1]},{ports[0]})"})

    for n in range(valves):
        nodes.append({"id": f"valve_{n}", "class": "ChemputerValve"})
        nodes.append({"id": f"pump_{n}", "class": "ChemputerPump", "max_volume": 25})
        join(f"valve_{n}", f"pump_{n}", (-1, 0), both=True)
        if n:
            join(f"valve_{n - 1}", f"valve_{n}", (1, 2), both=True)
        for port, name in ((0, "waste"), (3, "flask"), (4, "reactor"), (5, "product")):
            if len(nodes) >= 35 and valves == _VALVES["35 nodes"]:
                break
            nodes.append({"id": f"{name}_{n}", "class": "ChemputerReactor"})
            join(f"valve_{n}", f"{name}_{n}", (port, 0), both=True)
    return {"nodes": nodes, "links": links}


def _pairs(rig: Rig, count: int) -> list[tuple[str, str]]:
    vessels = [e.key for e in rig.network.elements if e.role is ElementRole.VESSEL]
    chance = random.Random(6)
    return [tuple(chance.sample(vessels, 2)) for _ in range(count)]  # type: ignore[misc]


def _median_ms(  # time of this process alone: others may share the machine
    act: Callable[[str, str], object], pairs: list[tuple[str, str]]
) -> float:
    taken = []
    for source, target in pairs:
        begun = time.process_time()
        act(source, target)
        taken.append(1000 * (time.process_time() - begun))
    return median(taken)


def _networkx(graph: dict[str, Any]) -> Callable[[str, str], object] | None:
    try:
        networkx = importlib.import_module("networkx")
    except ImportError:
        return None
    drawn = networkx.MultiDiGraph()
    drawn.add_edges_from((link["source"], link["target"]) for link in graph["links"])
    return lambda source, target: networkx.shortest_path(drawn, source, target)


def speed() -> int:
    """Measure both rigs, print, and fail when a limit is broken."""
    is_slow = False
    for name, limit_ms in LIMITS_MS.items():
        graph = backbone(_VALVES[name])
        begun = time.perf_counter()
        rig = read_rig(json.dumps(graph).encode())
        pairs = _pairs(rig, 200)
        read_ms = 1000 * (time.perf_counter() - begun)

        def compile_pair(source: str, target: str, rig: Rig = rig) -> None:
            line = json.dumps({"from": source, "to": target, "volume": "10 mL"}).encode()
            answer = compile_line(rig, line)
            if not answer["ok"]:
                raise SystemExit(f"{source} to {target}: {answer['findings']}")

        taken_ms = _median_ms(compile_pair, pairs)
        is_slow |= taken_ms > limit_ms
        peer = _networkx(graph)
        beside = f"{_median_ms(peer, pairs):.3f} ms" if peer else "not installed"
        sys.stdout.write(
            f"{name} ({len(graph['nodes'])} nodes): median {taken_ms:.3f} ms per compile "
            f"(limit {limit_ms} ms), read once in {read_ms:.0f} ms; "
            f"networkx.shortest_path alone: {beside}\n"
        )
    return 1 if is_slow else 0


def counts(folder: Path) -> Counter[str]:
    """Count what compiles and what is refused, by the code of its first finding."""
    found: Counter[str] = Counter()
    for path in sorted(p for p in folder.rglob("*") if p.name.endswith(("json", "ml", "ml.gz"))):
        raw = path.read_bytes()
        try:
            rig = read_rig(gzip.decompress(raw) if path.suffix == ".gz" else raw)
        except LabFileError:
            continue
        if not any(tube.medium.value == "liquid" for tube in rig.tubes):
            continue
        found["graphs"] += 1
        vessels = [e.key for e in rig.network.elements if e.role is ElementRole.VESSEL]
        for source in vessels:
            for target in vessels:
                for volume in VOLUMES if source != target else ():
                    line = json.dumps({"from": source, "to": target, "volume": volume}).encode()
                    answer = compile_line(rig, line)
                    found["ok" if answer["ok"] else answer["findings"][0]["code"]] += 1
    return found


def main() -> int:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", nargs="+", type=Path, default=[])
    folders = parser.parse_args().counts
    for folder in folders:
        sys.stdout.write(f"{folder}: {json.dumps(dict(counts(folder).most_common()))}\n")
    return 0 if folders else speed()


if __name__ == "__main__":
    sys.exit(main())
