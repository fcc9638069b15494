"""Liquid: the level follows from the volume, and between events from the plunger."""

import itertools
import math

import msgspec
import pytest

from tests.twin import labs
from twin import meshes, profile
from twin.levels import volumes_ul
from twin.meshes import Form
from twin.profile import Profile
from twin.state import Snapshot

SHARES = [step / 40 for step in range(41)]


def test_in_a_cylinder_half_the_volume_stands_at_half_the_height() -> None:
    wall = profile.cylinder(20.0, 5.0, 105.0)

    assert wall.volume_mm3 == pytest.approx(math.pi * 400.0 * 100.0)
    for share in SHARES:
        assert wall.level_mm(share) == pytest.approx(100.0 * share)


@pytest.mark.parametrize(("low", "high"), [(30.0, 10.0), (5.0, 25.0), (20.0, 1e-9)])
def test_in_a_cone_the_level_gives_back_exactly_the_volume(low: float, high: float) -> None:
    wall = profile.cone(low, high, 0.0, 80.0)

    for share in SHARES:
        level = wall.level_mm(share)
        radius = low + (high - low) * level / 80.0
        below = math.pi * level * (low * low + low * radius + radius * radius) / 3.0
        assert below == pytest.approx(share * wall.volume_mm3, abs=1e-6 * wall.volume_mm3)


@pytest.mark.parametrize(
    "wall",
    [
        profile.cylinder(10.0, 0.0, 50.0),
        profile.cone(30.0, 8.0, 2.0, 70.0),
        profile.sphere(40.0, 1.0),
        Profile(((2.0, 0.0), (12.0, 20.0), (12.0, 90.0))),
    ],
)
def test_more_volume_always_stands_higher(wall: Profile) -> None:
    levels = [wall.level_mm(share) for share in SHARES]

    assert all(low < high for low, high in itertools.pairwise(levels))
    assert levels[0] == pytest.approx(0.0)
    assert levels[-1] == pytest.approx(wall.height_mm)


def test_a_level_outside_the_vessel_is_cut_off() -> None:
    wall = profile.cylinder(10.0, 0.0, 50.0)

    assert wall.level_mm(-0.5) == 0.0
    assert wall.level_mm(7.0) == 50.0


@pytest.mark.parametrize("kind", ["bottle", "flask", "reactor", "vial", "tube", "syringe_pump"])
def test_the_liquid_that_is_drawn_has_the_share_of_the_volume_it_stands_for(kind: str) -> None:
    form = Form(kind, (60.0, 60.0, 90.0))
    full = meshes.liquid(form, 1.0)
    assert full is not None

    for share in (0.1, 0.5, 0.9):
        wet = meshes.liquid(form, share)
        assert wet is not None
        solid = wet.to_trimesh()
        assert solid.is_watertight
        assert solid.volume == pytest.approx(share * full.to_trimesh().volume, rel=1e-4)


def test_a_full_syringe_has_its_plunger_down() -> None:
    form = Form("syringe_pump", (45.0, 115.0, 128.0))

    empty, full = (meshes.plunger(form, share).vertices_mm[:, 2].max() for share in (0.0, 1.0))

    assert empty - full == pytest.approx(128.0 * 0.4, rel=1e-4)


def _with_plunger(volume_ul: float, job: dict[str, object]) -> Snapshot:
    data = labs.body()
    data["telemetry"] = {"d1": {"volume_ul": [2.0, volume_ul]}}
    data["jobs"] = {"j": {"id": "j", "device_id": "d1", "sentence": "Draw", **job}}
    return msgspec.convert(data, Snapshot)


ASPIRATE = {"source_id": "id-bottle", "target_id": "id-pump", "amount_nl": 4_000_000}


def test_while_the_pump_draws_the_bottle_falls_by_what_the_syringe_rises() -> None:
    volumes = volumes_ul(_with_plunger(1500.0, {"state": "running", **ASPIRATE}))

    assert volumes["id-pump"] == pytest.approx(1500.0)
    assert volumes["id-bottle"] == pytest.approx(250_000.0 - 1500.0)


def test_a_job_never_shows_more_moved_than_it_may_move() -> None:
    volumes = volumes_ul(_with_plunger(4900.0, {"state": "running", **ASPIRATE}))

    assert volumes["id-pump"] == pytest.approx(4000.0)


def test_without_a_job_at_work_the_record_stands() -> None:
    volumes = volumes_ul(_with_plunger(1500.0, {"state": "in_doubt", **ASPIRATE}))

    assert volumes["id-pump"] == 0.0
    assert volumes["id-bottle"] == pytest.approx(250_000.0)
