"""The lab as a robot: what has a place stands there, and what moves is a joint."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import msgspec
import pytest

from labweb.domain.errors import DefinitionError
from tests.twin.labs import body, pose
from twin.robot import ROOM, follow, link_name, robot_of
from twin.state import Snapshot


def a_lab(**telemetry: Any) -> Snapshot:  # noqa: ANN401 - any value
    data = body()
    data["telemetry"] = {"d1": {name: (1.0, value) for name, value in telemetry.items()}}
    return msgspec.convert(data, Snapshot)


def test_what_has_a_known_place_is_a_link_there_in_metres() -> None:
    robot = robot_of(a_lab())
    places = {one.child: one for one in robot.placed}
    assert places["bottle"].parent == ROOM
    assert places["bottle"].position_m == pytest.approx((0.1, 0.3, 0.03))
    assert places["reactor"].position_m == pytest.approx((0.55, 0.16, 0.115))
    assert "timer" not in places, "nobody knows where it is"


def test_the_description_is_one_tree_of_all_that_is_placed() -> None:
    robot = robot_of(a_lab())
    root = ET.fromstring(robot.description)
    links = {one.get("name") for one in root.iter("link")}
    parents = {
        joint.find("child").get("link"): joint.find("parent").get("link")  # type: ignore[union-attr]
        for joint in root.iter("joint")
    }
    assert links == {ROOM, *(one.child for one in robot.placed)}
    assert parents == {one.child: one.parent for one in robot.placed}
    assert len(list(root.iter("link"))) == len(links)


def test_the_box_of_a_link_is_the_body_of_the_thing() -> None:
    root = ET.fromstring(robot_of(a_lab()).description)
    visual = root.find("link[@name='bottle']/visual")
    assert visual is not None
    assert visual.find("geometry/box").get("size") == "0.08 0.08 0.18"  # type: ignore[union-attr]
    assert visual.find("origin").get("xyz") == "0.04 0.04 0.09"  # type: ignore[union-attr]


def test_a_plunger_slides_and_a_rotor_turns_as_the_device_told() -> None:
    robot = robot_of(a_lab(volume_ul=2500.0, port_index=3))
    assert robot.joints["pump_plunger_joint"] == pytest.approx(0.128 * 0.6 / 2)
    assert robot.joints["valve_rotor_joint"] == pytest.approx(math.pi / 2)
    rotor = next(one for one in robot.placed if one.child == "valve_rotor")
    assert rotor.xyzw == pytest.approx((0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)))


@pytest.mark.parametrize("value", [None, True, "3"])
def test_what_a_device_has_not_told_is_no_joint_state(value: object) -> None:
    assert robot_of(a_lab(volume_ul=value, port_index=value)).joints == {}


def test_keys_that_would_be_one_name_stay_two_links() -> None:
    data = body()
    twin = dict(data["resources"]["id-bottle"], id="id-other", key="Bottle", pose=pose(1, 2, 3))
    data["resources"]["id-other"] = twin
    data["telemetry"] = {}
    names = [one.child for one in robot_of(msgspec.convert(data, Snapshot)).placed]
    assert len(set(names)) == len(names)
    assert link_name("Ölbad 2", "") == "lbad_2"


def test_hostile_names_stay_text() -> None:
    data = body()
    data["lab"]["key"] = '"><evil/>'
    data["telemetry"] = {}
    text = robot_of(msgspec.convert(data, Snapshot)).description
    assert "evil/" not in text
    assert ET.fromstring(text).get("name") == "evil"


def test_a_twin_that_is_not_configured_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError):
        follow(tmp_path / "none.json", lambda _: None, every_s=0.1)
