"""The lab's scene for RViz: `/robot_description`, `/tf` and `/joint_states`.

The scene is the twin's, which is loaded by name: a host without it has no scene to tell.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from drivers.transports.ros2.bus import Bus
from labweb.domain.errors import DefinitionError, LabError

log = logging.getLogger(__name__)

TWIN = "twin.robot"
DESCRIPTION, TRANSFORMS, JOINTS = "/robot_description", "/tf", "/joint_states"


class PlacedLink(Protocol):
    """Where one link stands, metres and (x, y, z, w)."""

    @property
    def parent(self) -> str: ...  # noqa: D102 - as in the twin
    @property
    def child(self) -> str: ...  # noqa: D102
    @property
    def position_m(self) -> tuple[float, float, float]: ...  # noqa: D102
    @property
    def xyzw(self) -> tuple[float, float, float, float]: ...  # noqa: D102


class RobotDescription(Protocol):
    """A lab at one moment."""

    @property
    def description(self) -> str: ...  # noqa: D102 - as in the twin
    @property
    def placed(self) -> Sequence[PlacedLink]: ...  # noqa: D102
    @property
    def joints(self) -> Mapping[str, float]: ...  # noqa: D102


class SceneTopics:
    """Tells one lab."""

    def __init__(self, bus: Bus, wall_s: Callable[[], float] = time.time) -> None:
        self._wall_s = wall_s
        self._told = ""
        self._description = bus.publisher(DESCRIPTION, "std_msgs/msg/String", is_lasting=True)
        self._transforms = bus.publisher(TRANSFORMS, "tf2_msgs/msg/TFMessage")
        self._joints = bus.publisher(JOINTS, "sensor_msgs/msg/JointState")

    def hear(self, robot: RobotDescription | None) -> None:
        """Tell the lab as it is now; nothing, while nobody knows how it is."""
        if robot is None:
            return
        try:
            self._tell(robot)
        except LabError as error:
            log.warning("the scene cannot be told: %s", error)

    def _tell(self, robot: RobotDescription) -> None:
        if robot.description != self._told:
            self._told = robot.description
            self._description.publish({"data": robot.description})
        now_s = self._wall_s()
        stamp = {"sec": int(now_s), "nanosec": int(now_s % 1 * 1e9)}
        self._transforms.publish({"transforms": [_transform(one, stamp) for one in robot.placed]})
        if robot.joints:
            self._joints.publish(
                {
                    "header": {"stamp": stamp},
                    "name": list(robot.joints),
                    "position": list(robot.joints.values()),
                }
            )


def _transform(placed: PlacedLink, stamp: dict[str, int]) -> dict[str, Any]:
    translation = dict(zip("xyz", placed.position_m, strict=True))
    rotation = dict(zip("xyzw", placed.xyzw, strict=True))
    return {
        "header": {"stamp": stamp, "frame_id": placed.parent},
        "child_frame_id": placed.child,
        "transform": {"translation": translation, "rotation": rotation},
    }


def begin(bus: Bus, twin_config: Path, rate_hz: float) -> SceneTopics:
    """Follow the lab and tell it, on a thread.

    Raises:
        DefinitionError: The twin is not installed here, or its configuration cannot be read.
    """
    try:
        twin = import_module(TWIN)
    except ImportError as error:
        text = f"{error}: this host lacks the extra twin"
        raise DefinitionError(text, code="ros2.no_scene") from error
    scene = SceneTopics(bus)
    twin.follow(twin_config, scene.hear, every_s=1.0 / rate_hz)
    return scene
