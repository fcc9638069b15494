"""Where ports are, and the way a tube takes from one to the other."""

from __future__ import annotations

import math
from dataclasses import dataclass

from labweb.domain.resources.resource_kinds import is_vessel
from twin.frames import Frame, Vector, rotate
from twin.meshes import Form, axis_of, inside_of, syringe_axis

_VALVE_SWEEP_DEG = 300.0
"""Ports share the circle but for the gap at the bottom, where the common port is."""

_REACTOR_NECKS = (-0.55, 0.55, 0.0)


@dataclass(frozen=True)
class Mouth:
    """One end of a tube.

    Frame:
        The resource's own, mm.
    """

    at_mm: Vector
    outward: Vector
    """Direction in which the tube leaves; length 1."""

    end_mm: Vector | None = None
    """Where it ends inside a vessel."""


def mouth(form: Form, port: str, *, common_port: str, number: int, count: int) -> Mouth:
    """Find where the tube of a port leaves a resource.

    Args:
        form: The resource.
        port: Name of the port.
        common_port: Name of a valve's common port.
        number: Place of the port among those in use, from 0.
        count: How many ports are in use.
    """
    width, depth, height = form.size_mm
    if form.kind in {"rotary_valve", "solenoid_valve"}:
        return _valve_mouth(form, port, common_port, number, count)
    if form.kind == "syringe_pump":
        x, y = syringe_axis(form)
        return Mouth((x, y, height), (0.0, -0.7, 0.7))
    if is_vessel(form.kind):
        return _vessel_mouth(form, number, count)
    return Mouth((width / 2.0, depth / 2.0, height), (0.0, 0.0, 1.0))


def _valve_mouth(form: Form, port: str, common_port: str, number: int, count: int) -> Mouth:
    width, depth, height = form.size_mm
    radius = min(width, height) * 0.36
    if port == common_port:
        angle = -math.pi / 2.0
    else:
        is_numbered = port.isascii() and port.isdigit() and 1 <= int(port) <= form.ports_count
        place, places = (int(port) - 1, form.ports_count) if is_numbered else (number, count)
        start = 90.0 + _VALVE_SWEEP_DEG / 2.0
        angle = math.radians(start - _VALVE_SWEEP_DEG * (place + 0.5) / max(places, 1))
    dx, dz = math.cos(angle), math.sin(angle)
    at = (width / 2.0 + radius * dx, depth * 0.12, height / 2.0 + radius * dz)
    return Mouth(at, (dx * 0.6, -0.7, dz * 0.6))


def _vessel_mouth(form: Form, number: int, count: int) -> Mouth:
    x, y = axis_of(form)
    radius = min(form.size_mm[0], form.size_mm[1]) / 2.0
    if form.kind == "reactor":
        shift = radius * _REACTOR_NECKS[number % len(_REACTOR_NECKS)]
    else:
        spread = min(6.0, radius * 0.5 / max(count, 1))
        shift = (number - (count - 1) / 2.0) * spread
    room = inside_of(form)
    low = form.size_mm[2] * 0.2
    if room is not None:
        low = room.points_mm[0][1] + room.height_mm * 0.06
    return Mouth((x + shift, y, form.size_mm[2]), (0.0, 0.0, 1.0), (x + shift, y, low))


def route(
    source: tuple[Frame, Mouth], target: tuple[Frame, Mouth], lane: int
) -> tuple[Vector, ...]:
    """Lead a tube from mouth to mouth, in an arch above both.

    Args:
        source: Frame and mouth of one end.
        target: Frame and mouth of the other.
        lane: Number of the tube; neighbours arch a little higher, so that one can tell them
            apart.
    """
    start, goal = (frame.to_room(end.at_mm) for frame, end in (source, target))
    distance = math.dist(start, goal)
    stub = min(28.0, distance * 0.3)
    leave, arrive = (
        _along(point, rotate(frame.wxyz, end.outward), stub)
        for point, (frame, end) in zip((start, goal), (source, target), strict=True)
    )
    points = [*_inside(source)[::-1], start, leave]
    if distance > 4 * stub:
        peak = max(leave[2], arrive[2]) + distance * 0.06 + 9.0 * (lane % 5)
        for share in (0.3, 0.7):
            x, y = (leave[axis] + (arrive[axis] - leave[axis]) * share for axis in (0, 1))
            points.append((x, y, peak))
    points += [arrive, goal, *_inside(target)]
    return tuple(points)


def _along(point: Vector, direction: Vector, length: float) -> Vector:
    x, y, z = (value + step * length for value, step in zip(point, direction, strict=True))
    return x, y, z


def _inside(end: tuple[Frame, Mouth]) -> list[Vector]:
    frame, found = end
    return [] if found.end_mm is None else [frame.to_room(found.end_mm)]
