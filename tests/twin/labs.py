"""A small bench, as the feed tells it."""

from __future__ import annotations

import copy
from typing import Any

import msgspec

from twin.state import Snapshot


def resource(key: str, kind: str, parent: str | None, **fields: object) -> dict[str, Any]:
    """One row; its id is `id-<key>`."""
    return {
        "id": f"id-{key}",
        "key": key,
        "parent_id": None if parent is None else f"id-{parent}",
        "name": key.replace("_", " ").capitalize(),
        "kind": kind,
        **fields,
    }


def pose(x: float, y: float, z: float, *wxyz: float) -> dict[str, Any]:
    """A pose; without a rotation it is upright."""
    return {"x_mm": x, "y_mm": y, "z_mm": z, "rotation_wxyz": wxyz or (1.0, 0.0, 0.0, 0.0)}


_ROWS = [
    resource("lab", "lab", None),
    resource("bench", "bench", "lab", pose=pose(0, 0, 0), size_mm=(1000, 500, 30)),
    resource(
        "bottle",
        "bottle",
        "bench",
        pose=pose(100, 300, 30),
        size_mm=(80, 80, 180),
        capacity_ul=500_000,
        contents_nl={"0": 250_000_000},
    ),
    resource(
        "pump", "syringe_pump", "bench", pose=pose(300, 300, 30), size_mm=(45, 115, 128),
        capacity_ul=5000,
    ),
    resource(
        "valve", "rotary_valve", "bench", pose=pose(300, 300, 158), size_mm=(45, 45, 45),
        ports_count=8,
    ),
    resource("heater", "heater_stirrer", "bench", pose=pose(500, 100, 30)),
    resource(
        "reactor", "reactor", "heater", pose=pose(50, 60, 85), size_mm=(60, 60, 90),
        capacity_ul=100_000,
    ),
    resource("timer", "timer", "bench"),
]  # fmt: skip

_TUBES = [("pump", "out", "valve", "common"), ("valve", "1", "bottle", "neck")]


def body() -> dict[str, Any]:
    """The data of a snapshot message."""
    connections = {
        f"t{number}": {
            "id": f"t{number}",
            "key": f"tube_{number}",
            "source": {"resource_id": f"id-{source}", "port": source_port},
            "target": {"resource_id": f"id-{target}", "port": target_port},
        }
        for number, (source, source_port, target, target_port) in enumerate(_TUBES)
    }
    device = {
        "id": "d1",
        "name": "Pump",
        "nodes": {"pump": "id-pump", "valve": "id-valve"},
        "state": "enrolled",
        "link": "online",
    }
    return copy.deepcopy(
        {
            "lab": {"key": "small", "name": "Small lab", "mode": "sim", "is_stopped": False},
            "resources": {row["id"]: row for row in _ROWS},
            "connections": connections,
            "devices": {"d1": device},
            "jobs": {},
            "telemetry": {"d1": {"volume_ul": [1.0, 0.0]}},
        }
    )


def snapshot(**jobs: object) -> Snapshot:
    """The snapshot itself, with these jobs by id."""
    found = body()
    found["jobs"] = jobs
    return msgspec.convert(found, Snapshot)
