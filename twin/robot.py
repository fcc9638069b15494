"""The lab as a robot: links, joints and where they stand, for whoever draws robots.

Each thing with a body and a known place is a link below the room. What turns or slides inside
an instrument is a joint of it: the rotor of a valve, the plunger of a syringe.

Source:
    URDF/XML, robot and joint elements; REP 103 for metres, radians, x right, y to the back and
    z up, which is how the room is measured here already.
"""

from __future__ import annotations

import asyncio
import math
import re
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

from twin.frames import ABSTRACT, STILL, Frame, Quaternion, Vector, frames_of
from twin.sizes import size_of
from twin.state import Snapshot, TwinLabView, TwinResource
from twin.sync import FeedClient, read_config

ROOM = "room"
STALE_S = 3.0
"""Longer than the feed is ever silent."""

MOST_LINKS = 2000
_PARTS = frozenset({"well", "tip_spot", "slot"})
"""Places within a body, which is drawn as a whole."""

_VALVES = frozenset({"rotary_valve"})
_SYRINGES = frozenset({"syringe_pump"})
_GREY = "0.62 0.66 0.7 1"
_MOVING = "0.2 0.55 0.75 1"
_THICK_MM = 8.0


@dataclass(frozen=True, slots=True)
class Placed:
    """One link and where it stands in its parent's frame.

    Frame:
        Metres and a unit quaternion (x, y, z, w).
    """

    parent: str
    child: str
    position_m: Vector
    xyzw: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Robot:
    """A lab at one moment."""

    description: str
    """URDF."""

    placed: tuple[Placed, ...]
    joints: Mapping[str, float] = field(default_factory=dict)
    """Radians or metres by name; only those that the instrument told."""


def robot_of(snapshot: Snapshot) -> Robot:
    """Return the lab as a robot. The origin of a link is its front left bottom corner.

    What has no known place is left out: nothing is put where it may not be.
    """
    frames, _ = frames_of(snapshot.resources)
    rows = [
        row
        for row in sorted(snapshot.resources.values(), key=lambda one: one.key)
        if row.id in frames and row.kind not in ABSTRACT | _PARTS and not row.is_archived
    ][:MOST_LINKS]
    root = Element("robot", name=link_name(snapshot.lab.key, ""))
    SubElement(root, "link", name=ROOM)
    placed: list[Placed] = []
    joints: dict[str, float] = {}
    names: set[str] = {ROOM}
    told = _told_by_node(snapshot)
    for row in rows:
        name = link_name(row.key, row.id if link_name(row.key, "") in names else "")
        names.add(name)
        size = size_of(row)
        width, depth, height = size
        _add_link(root, name, size, _GREY, (width / 2, depth / 2, height / 2))
        _add_joint(root, "floating", ROOM, name)
        placed.append(_place(ROOM, name, frames[row.id]))
        moving = _moving_part(root, row, name, told.get(row.id, {}))
        if moving is not None:
            placed.append(moving[0])
            joints |= moving[1]
    text = tostring(root, encoding="unicode", xml_declaration=False)
    return Robot('<?xml version="1.0"?>' + text, tuple(placed), joints)


def link_name(key: str, tail: str) -> str:
    """Turn a key into the name of a link; `tail` keeps two apart that would be one.

    Example:
        >>> link_name("pump-1", ""), link_name("pump 1", "018f3c5e-0000")
        ('pump_1', 'pump_1_018f3c5e')
    """
    plain = re.sub(r"_+", "_", re.sub(r"[^a-zA-Z0-9]", "_", key)).strip("_").lower() or "thing"
    return f"{plain}_{tail[:8]}" if tail else plain


def _told_by_node(snapshot: Snapshot) -> dict[str, dict[str, Any]]:
    """Return what devices told last, by resource."""
    found: dict[str, dict[str, Any]] = {}
    for device in snapshot.devices.values():
        statuses = snapshot.telemetry.get(device.id, {})
        for node in device.nodes.values():
            found.setdefault(node, {}).update({k: value for k, (_, value) in statuses.items()})
    return found


def _moving_part(
    root: Element, row: TwinResource, name: str, told: Mapping[str, Any]
) -> tuple[Placed, dict[str, float]] | None:
    """Draw what moves in an instrument; where it stands is unknown until the device tells."""
    width, depth, height = size_of(row)
    if row.kind in _VALVES and row.ports_count:
        joint, part = f"{name}_rotor_joint", f"{name}_rotor"
        _add_link(root, part, (width * 0.8, _THICK_MM, _THICK_MM), _MOVING, (0.0, 0.0, 0.0))
        top = (width / 2, depth / 2, height + _THICK_MM / 2)
        _add_joint(root, "continuous", name, part, joint, top)
        port = _number(told.get("port_index"))
        angle = 0.0 if port is None else 2.0 * math.pi * (port - 1) / row.ports_count
        turn = (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))
        return _place(name, part, Frame(top, turn)), {} if port is None else {joint: angle}
    if row.kind in _SYRINGES and row.capacity_ul:
        joint, part = f"{name}_plunger_joint", f"{name}_plunger"
        stroke_mm = height * 0.6
        start = (width / 2, -_THICK_MM / 2, height * 0.2)
        _add_link(root, part, (width * 0.6, _THICK_MM, _THICK_MM), _MOVING, (0.0, 0.0, 0.0))
        _add_joint(root, "prismatic", name, part, joint, start, stroke_mm / 1000)
        volume = _number(told.get("volume_ul"))
        way_mm = stroke_mm * min(max((volume or 0.0) / row.capacity_ul, 0.0), 1.0)
        frame = Frame((start[0], start[1], start[2] + way_mm), STILL)
        return _place(name, part, frame), {} if volume is None else {joint: way_mm / 1000}
    return None


def _number(value: object) -> float | None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number else None  # type: ignore[arg-type]


def _place(parent: str, child: str, frame: Frame) -> Placed:
    x, y, z = (one / 1000.0 for one in frame.position_mm)
    w, i, j, k = _unit(frame.wxyz)
    return Placed(parent, child, (x, y, z), (i, j, k, w))


def _unit(wxyz: Quaternion) -> Quaternion:
    length = math.sqrt(sum(one * one for one in wxyz))
    w, x, y, z = (one / length for one in wxyz) if length else STILL
    return w, x, y, z


def _add_link(root: Element, name: str, size_mm: Vector, color: str, centre_mm: Vector) -> None:
    visual = SubElement(SubElement(root, "link", name=name), "visual")
    SubElement(visual, "origin", xyz=_metres(centre_mm), rpy="0 0 0")
    SubElement(SubElement(visual, "geometry"), "box", size=_metres(size_mm))
    material = SubElement(visual, "material", name="moving" if color == _MOVING else "still")
    SubElement(material, "color", rgba=color)


def _add_joint(  # noqa: PLR0913 - one attribute each
    root: Element,
    kind: str,
    parent: str,
    child: str,
    name: str = "",
    origin_mm: Vector = (0.0, 0.0, 0.0),
    stroke_m: float = 0.0,
) -> None:
    joint = SubElement(root, "joint", name=name or f"{child}_place", type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=_metres(origin_mm), rpy="0 0 0")
    if kind != "floating":
        SubElement(joint, "axis", xyz="0 0 1")
    if kind == "prismatic":
        SubElement(joint, "limit", lower="0", upper=f"{stroke_m:.6g}", effort="0", velocity="0")


def _metres(vector_mm: Vector) -> str:
    return " ".join(f"{one / 1000.0:.6g}" for one in vector_mm)


def follow(config: Path, hear: Callable[[Robot | None], None], *, every_s: float) -> None:
    """Follow a lab on a thread, for ever; None is told while there is no picture of now.

    Raises:
        DefinitionError: The twin's configuration cannot be read.
    """
    settings, token = read_config(config)
    view = TwinLabView()
    client = FeedClient(settings, token, view, None)

    async def tell() -> None:
        version, robot = -1, None
        while True:
            await asyncio.sleep(every_s)
            silence_s = client.silence_s()
            is_fresh = silence_s is not None and silence_s < STALE_S
            if view.snapshot is not None and view.version != version:
                version, robot = view.version, robot_of(view.snapshot)
            hear(robot if is_fresh else None)

    async def both() -> None:
        await asyncio.gather(client.run(), tell())

    threading.Thread(target=lambda: asyncio.run(both()), name="scene", daemon=True).start()
