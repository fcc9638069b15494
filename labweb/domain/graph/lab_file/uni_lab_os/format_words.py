"""The words of the format that say by themselves what a node or link is.

Source:
    Uni-Lab-OS lab graphs (node `type`, link `type`) and PyLabRobot's serialised
    resources (`category`); PyLabRobot states lengths in mm and volumes in µL.
"""

from __future__ import annotations

from collections.abc import Mapping

from labweb.domain.graph.lab_file.lab_model import UNI_LAB_OS
from labweb.domain.graph.ports_and_connections import Medium

FORMAT = UNI_LAB_OS
"""Name of the format, and of its place in `extra`."""

FOREIGN = "foreign"

ENDLESS = "Infinity"
"""What PyLabRobot writes as size where it means none."""

KIND_BY_TYPE: Mapping[str, str] = {
    "container": "vessel",
    "deck": "deck",
    "plate": "plate",
    "well": "well",
    "tip_rack": "tip_rack",
    "tip_spot": "tip_spot",
    "tube": "tube",
    "tube_rack": "tube_rack",
    "trough": "trough",
    "bottle": "bottle",
    "flask": "flask",
    "vial": "vial",
    "reactor": "reactor",
    "waste": "waste",
}
"""Node types that name a passive thing; `device` and all others say nothing."""

KIND_BY_CATEGORY: Mapping[str, str] = {
    "container": "vessel",
    "deck": "deck",
    "plate": "plate",
    "well": "well",
    "tip_rack": "tip_rack",
    "tip_spot": "tip_spot",
    "tube": "tube",
    "tube_rack": "tube_rack",
    "trough": "trough",
    "bottle": "bottle",
    "trash": "waste",
    "carrier": "carrier",
    "plate_carrier": "carrier",
    "tip_carrier": "carrier",
    "trough_carrier": "carrier",
    "tube_carrier": "carrier",
    "resource_holder": "slot",
    "plate_holder": "slot",
}
"""Categories of serialised PyLabRobot resources."""

MEDIUM_BY_TYPE: Mapping[str, Medium] = {
    "fluid": Medium.LIQUID,
    "thermal": Medium.THERMAL,
    "mechanical": Medium.MECHANICAL,
    "communication": Medium.COMMUNICATION,
    "transport": Medium.TRANSPORT,
}
"""Link types with one meaning. `physical`, `logical`, `resource` and none stay `other`."""


def is_pylabrobot(config: object) -> bool:
    """Tell whether a node's config is a PyLabRobot resource, serialised by that package."""
    if not isinstance(config, Mapping) or "category" not in config:
        return False
    rotation = config.get("rotation")
    return isinstance(rotation, Mapping) and rotation.get("type") == "Rotation"
