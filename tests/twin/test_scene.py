"""Where things stand, what is parked, and which state they show."""

import math
from itertools import combinations, product

import msgspec
import numpy as np
import pytest

from tests.twin import labs
from twin import camera
from twin.frames import Frame, frames_of
from twin.scene import TRAY_KEY, Scene, Surface, Thing, describe
from twin.state import Snapshot


def _with(**rows: dict[str, object]) -> Snapshot:
    data = labs.body()
    for key, fields in rows.items():
        data["resources"][f"id-{key}"].update(fields)
    return msgspec.convert(data, Snapshot)


def test_a_vessel_on_a_heater_on_a_bench_stands_at_the_sum_of_their_poses() -> None:
    scene = describe(labs.snapshot())

    assert scene.things["reactor"].frame.position_mm == pytest.approx((550.0, 160.0, 115.0))


def test_turning_what_is_below_turns_what_stands_on_it() -> None:
    quarter = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # 90° about z: x goes to the back
    snapshot = _with(heater={"pose": labs.pose(500, 100, 30, *quarter)})

    frame = describe(snapshot).things["reactor"].frame

    assert frame.position_mm == pytest.approx((500.0 - 60.0, 100.0 + 50.0, 115.0))
    assert frame.wxyz == pytest.approx(quarter)


def test_two_quarter_turns_along_the_tree_are_a_half_turn() -> None:
    quarter = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    snapshot = _with(
        heater={"pose": labs.pose(500, 100, 30, *quarter)},
        reactor={"pose": labs.pose(50, 60, 85, *quarter)},
    )

    frame = describe(snapshot).things["reactor"].frame

    assert frame.wxyz == pytest.approx((0.0, 0.0, 0.0, 1.0))
    assert frame.to_room((10.0, 0.0, 0.0))[0] == pytest.approx(frame.position_mm[0] - 10.0)


def test_what_has_no_pose_is_parked_beside_the_bench_and_says_so() -> None:
    scene = describe(labs.snapshot())
    timer = scene.things["timer"]

    assert timer.is_parked
    assert timer.frame.position_mm[0] > 1000.0
    assert scene.captions["timer"].text == "Timer"
    assert scene.captions[TRAY_KEY].text == "pose unknown"
    assert not scene.things["bottle"].is_parked
    assert "bottle" not in scene.captions


def test_what_stands_on_a_parked_thing_goes_with_it() -> None:
    scene = describe(_with(heater={"pose": None}))

    heater, reactor = scene.things["heater"].frame, scene.things["reactor"].frame
    assert heater.position_mm[0] > 1000.0
    assert np.subtract(reactor.position_mm, heater.position_mm) == pytest.approx((50, 60, 85))


def _footprint(thing: Thing) -> tuple[np.ndarray, np.ndarray]:
    corners = np.concatenate([surface.mesh.vertices_mm for surface in thing.surfaces])
    at = np.asarray(thing.frame.position_mm)
    return corners.min(axis=0) + at, corners.max(axis=0) + at


def test_a_lab_without_any_pose_is_laid_out_in_rows_that_do_not_touch() -> None:
    data = labs.body()
    data["resources"] = {
        row["id"]: row
        for row in [
            labs.resource("lab", "lab", None),
            *(labs.resource(f"n{i}", kind, "lab") for i, kind in enumerate(_MANY_KINDS)),
        ]
    }
    data["connections"] = data["devices"] = data["telemetry"] = {}

    scene = describe(msgspec.convert(data, Snapshot))

    parked = [thing for key, thing in scene.things.items() if key != TRAY_KEY]
    assert len(parked) == len(_MANY_KINDS)
    assert all(thing.is_parked and thing.key in scene.captions for thing in parked)
    for one, other in combinations(map(_footprint, parked), 2):
        apart = np.maximum(one[0] - other[1], other[0] - one[1])[:2]
        assert apart.max() > 0.0
    width, depth, _ = np.subtract(scene.high_mm, scene.low_mm)
    assert 0.8 < width / depth < 3.0


_MANY_KINDS = ["bottle", "flask", "syringe_pump", "rotary_valve", "foreign", "reactor"] * 4


def test_an_archived_thing_is_gone_with_all_that_is_in_it() -> None:
    scene = describe(_with(heater={"is_archived": True}))

    assert "heater" not in scene.things
    assert "reactor" not in scene.things
    assert "bottle" in scene.things


def test_wells_are_drawn_with_their_plate_and_not_one_by_one() -> None:
    data = labs.body()
    rows = data["resources"]
    plate = labs.resource("plate", "plate", "bench", pose=labs.pose(700, 300, 30))
    wells = [
        labs.resource(f"w{i}", "well", "plate", pose=labs.pose(9.0 * i, 9.0, 2.0))
        for i in range(96)
    ]
    rows.update({row["id"]: row for row in [plate, *wells]})

    scene = describe(msgspec.convert(data, Snapshot))

    assert [surface.name for surface in scene.things["plate"].surfaces] == ["ware", "cells"]
    assert not any(key.startswith("w") for key in scene.things)


def _job(state: str) -> dict[str, str]:
    return {"id": "j", "device_id": "d1", "state": state, "sentence": "Draw"}


def test_a_running_device_has_one_whole_ring_and_no_label() -> None:
    scene = describe(labs.snapshot(j=_job("running")))

    assert scene.things["pump"].state == "running"
    assert scene.things["valve"].state == "idle"
    assert "pump" not in scene.captions


def _gaps(ring: Surface) -> int:
    """Count the wide gaps on the way around a ring."""
    flat = ring.mesh.vertices_mm[:, :2].astype(float)
    flat -= (flat.min(axis=0) + flat.max(axis=0)) / 2.0
    angles = np.sort(np.degrees(np.arctan2(flat[:, 1], flat[:, 0])))
    steps = np.diff(np.append(angles, angles[0] + 360.0))
    return int((steps > 8.0).sum())


def test_a_device_in_doubt_has_a_dashed_ring_and_a_label() -> None:
    running = describe(labs.snapshot(j=_job("running"))).things["pump"].surfaces[-1]
    doubted = describe(labs.snapshot(j=_job("in_doubt")))
    ring = doubted.things["pump"].surfaces[-1]

    assert ring.role.value == "doubt"
    assert ring.mesh.to_trimesh().is_watertight
    assert ring.mesh.to_trimesh().volume > 0.0
    assert _gaps(running) == 0
    assert _gaps(ring) == 12
    assert doubted.captions["pump"].text == "Pump · in doubt"


def test_a_quarantined_vessel_is_in_doubt() -> None:
    scene = describe(_with(bottle={"is_quarantined": True}))

    assert scene.things["bottle"].state == "in_doubt"


def test_tubes_run_between_their_mouths_above_the_bench() -> None:
    scene = describe(labs.snapshot())
    tube = scene.tubes["tube_1"]
    bottle = _footprint(scene.things["bottle"])

    assert np.all(np.asarray(tube.points_mm)[:, 2] > 30.0)
    end = np.asarray(tube.points_mm[-1])
    assert np.all(end >= bottle[0])
    assert np.all(end <= bottle[1])


@pytest.mark.parametrize("name", camera.VIEWS)
@pytest.mark.parametrize("aspect", [0.5, 1.0, 1.6, 2.4])
def test_every_view_shows_the_whole_scene_and_fills_the_picture(name: str, aspect: float) -> None:
    scene = describe(labs.snapshot())
    found = camera.view(name, scene.low_mm, scene.high_mm, aspect)
    eye, target = np.asarray(found.position_mm), np.asarray(found.look_at_mm)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    tall = math.tan(camera.FOV_RAD / 2.0)
    shown = []
    for corner in product(*zip(scene.low_mm, scene.high_mm, strict=True)):
        ray = np.asarray(corner) - eye
        depth = float(ray @ forward)
        shown.append((abs(ray @ right) / depth / (tall * aspect), abs(ray @ up) / depth / tall))
    assert np.max(shown) <= 1.0
    assert np.max(shown) > 0.9


def test_a_resource_whose_parent_is_missing_is_not_at_the_origin() -> None:
    data = labs.body()
    row = labs.resource("lost", "bottle", "nowhere", pose=labs.pose(1, 2, 3))
    data["resources"][row["id"]] = row
    snapshot = msgspec.convert(data, Snapshot)

    placed, _ = frames_of(snapshot.resources)

    assert "id-lost" not in placed
    assert "lost" not in describe(snapshot).things


def test_nothing_at_all_is_still_a_scene() -> None:
    data = labs.body()
    for table in ("resources", "connections", "devices", "telemetry"):
        data[table] = {}

    assert describe(msgspec.convert(data, Snapshot)) == Scene()
    assert Frame().to_room((1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)
