"""Parametric geometry per kind. Sizes come from the lab; the shapes are ours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import trimesh

from twin import profile
from twin.meshes.solids import Mesh, Offset, box, disc, merged, ring, rod_towards_front, turned
from twin.palette import Role
from twin.profile import Profile

_WALL_MM = 1.5
_MOST_CELLS = 1536
_LIFT_MM = 0.8
"""Glass ends above what it stands on, so that the two surfaces never share a pixel."""


@dataclass(frozen=True)
class Form:
    """What decides how a resource looks; equal forms share one mesh."""

    kind: str
    size_mm: Offset
    shape: str = ""
    """`round` for a flask with a round bottom."""

    top_at_mm: tuple[float, float] | None = None
    """Centre of a plate or pan: under what stands on it, when something does."""

    ports_count: int = 0
    cells_count: int = 0
    """Wells or tips, drawn with the ware that has them."""


@dataclass(frozen=True, eq=False)
class Piece:
    """One surface of one colour."""

    name: str
    role: Role
    mesh: Mesh


def axis_of(form: Form) -> tuple[float, float]:
    """Return where the vertical axis of a vessel stands in its own frame."""
    return form.size_mm[0] / 2.0, form.size_mm[1] / 2.0


def _radius(form: Form) -> float:
    return min(form.size_mm[0], form.size_mm[1]) / 2.0


def inside_of(form: Form) -> Profile | None:
    """Return the room for liquid in a vessel, in its own frame; None when it holds none."""
    radius, height = _radius(form), form.size_mm[2]
    inner = radius - min(_WALL_MM, radius * 0.2)
    match form.kind:
        case "bottle" | "waste":
            return profile.cylinder(inner, height * 0.02, height * 0.74)
        case "flask" if form.shape == "round":
            return profile.sphere(min(inner, height * 0.36), height * 0.02)
        case "flask":
            return profile.cone(inner, inner * 0.36, height * 0.02, height * 0.74)
        case "tube":
            return Profile(((inner * 0.2, 1.0), (inner, height * 0.25), (inner, height * 0.95)))
        case "reactor":
            return Profile(
                ((inner * 0.6, 1.0), (inner * 0.9, height * 0.05), (inner * 0.9, height * 0.86))
            )
        case "vial" | "vessel" | "trough" | "well":
            return profile.cylinder(inner, height * 0.03, height * 0.85)
        case "syringe_pump":
            low, high = _stroke(form)
            return profile.cylinder(form.size_mm[0] * 0.19, low, high)
    return None


@lru_cache(maxsize=512)
def liquid(form: Form, fraction: float) -> Mesh | None:
    """Build the liquid that fills this share of a vessel; None for an empty one.

    Its number of corners does not depend on the level, except where the wall bends.
    """
    room = inside_of(form)
    if room is None or fraction <= 0.0:
        return None
    if form.kind == "syringe_pump":
        _, high = _stroke(form)
        height = room.level_mm(fraction)
        points = profile.cylinder(room.points_mm[0][0], high - height, high).points_mm
        return merged(turned(points, syringe_axis(form)))
    # A hair narrower than the glass, so that the two surfaces never fight for the same pixel.
    points = tuple((r * 0.985, z) for r, z in room.below(room.level_mm(fraction)))
    return merged(turned(points, axis_of(form)))


@lru_cache(maxsize=512)
def plunger(form: Form, fraction: float) -> Mesh:
    """Build the plunger of a syringe pump; full means all the way down."""
    low, high = _stroke(form)
    head = high - (high - low) * min(max(fraction, 0.0), 1.0)
    radius, at = form.size_mm[0] * 0.19, syringe_axis(form)
    return merged(
        disc(radius * 0.98, head - 3.0, head, at),
        disc(radius * 0.3, head - (high - low) * 0.55, head - 3.0, at),
        disc(radius * 1.3, head - (high - low) * 0.55 - 4.0, head - (high - low) * 0.55, at),
    )


def syringe_axis(form: Form) -> tuple[float, float]:
    """Return where the syringe stands, in front of the pump's housing."""
    return form.size_mm[0] / 2.0, form.size_mm[1] * 0.14


def _stroke(form: Form) -> tuple[float, float]:
    return form.size_mm[2] * 0.50, form.size_mm[2] * 0.90


@lru_cache(maxsize=512)
def state_ring(form: Form, *, is_dashed: bool) -> Mesh:
    """Build the ring that lies around the foot of a resource."""
    width, depth, _ = form.size_mm
    radius = 0.56 * (width**2 + depth**2) ** 0.5
    thickness = min(max(radius * 0.045, 2.5), 5.0)
    dashes = 12 if is_dashed else 0
    return merged(ring(radius, thickness, thickness, (width / 2.0, depth / 2.0), dashes))


@lru_cache(maxsize=512)
def body(form: Form) -> tuple[Piece, ...]:
    """Build the surfaces of a resource that stay as they are."""
    return _BODIES.get(form.kind, _box)(form)


def _bottle(form: Form) -> tuple[Piece, ...]:
    radius, height, at = _radius(form), form.size_mm[2], axis_of(form)
    glass = turned(
        (
            (radius * 0.94, _LIFT_MM),
            (radius, height * 0.02),
            (radius, height * 0.74),
            (radius * 0.85, height * 0.80),
            (radius * 0.38, height * 0.86),
            (radius * 0.38, height * 0.90),
        ),
        at,
    )
    cap = disc(radius * 0.44, height * 0.88, height, at)
    return Piece("glass", Role.GLASS, merged(glass)), Piece("cap", Role.BODY, merged(cap))


def _flask(form: Form) -> tuple[Piece, ...]:
    radius, height, at = _radius(form), form.size_mm[2], axis_of(form)
    neck, lip = radius * 0.36, radius * 0.44
    if form.shape == "round":
        ball = min(radius, height * 0.38)
        wall = profile.sphere(ball, _LIFT_MM).points_mm
        foot = disc(ball * 0.55, 0.0, height * 0.05, at)
        outline = (*wall[1:], (neck, wall[-1][1] + 2.0), (neck, height * 0.97), (lip, height))
        return (
            Piece("glass", Role.GLASS, merged(turned(outline, at))),
            Piece("foot", Role.BODY, merged(foot)),
        )
    outline = (
        (radius * 0.96, _LIFT_MM),
        (radius, height * 0.03),
        (neck, height * 0.76),
        (neck, height * 0.96),
        (lip, height),
    )
    return (Piece("glass", Role.GLASS, merged(turned(outline, at))),)


def _reactor(form: Form) -> tuple[Piece, ...]:
    radius, height, at = _radius(form), form.size_mm[2], axis_of(form)
    wall = turned(((radius * 0.7, _LIFT_MM), (radius, height * 0.06), (radius, height * 0.88)), at)
    lid = disc(radius * 1.0, height * 0.88, height * 0.93, at)
    necks = [
        disc(radius * 0.16, height * 0.93, height, (at[0] + radius * dx, at[1] + radius * dy))
        for dx, dy in ((0.0, 0.0), (-0.55, 0.0), (0.55, 0.0))
    ]
    return (
        Piece("glass", Role.GLASS, merged(wall)),
        Piece("lid", Role.BODY, merged(lid, *necks)),
    )


def _waste(form: Form) -> tuple[Piece, ...]:
    radius, height, at = _radius(form), form.size_mm[2], axis_of(form)
    outline = (
        (radius * 0.97, _LIFT_MM),
        (radius, height * 0.02),
        (radius, height * 0.76),
        (radius * 0.5, height * 0.88),
        (radius * 0.5, height * 0.92),
    )
    rims = [
        turned(((radius * 1.02, height * z), (radius * 1.02, height * z + 4.0)), at)
        for z in (0.06, 0.72)
    ]
    cap = disc(radius * 0.56, height * 0.90, height, at)
    return (
        Piece("glass", Role.GLASS, merged(turned(outline, at))),
        Piece("cap", Role.DARK, merged(cap, *rims)),
    )


def _beaker(form: Form) -> tuple[Piece, ...]:
    radius, height, at = _radius(form), form.size_mm[2], axis_of(form)
    wall = turned(((radius, _LIFT_MM), (radius, height * 0.98), (radius * 1.04, height)), at)
    return (Piece("glass", Role.GLASS, merged(wall)),)


def _tube(form: Form) -> tuple[Piece, ...]:
    radius, height, at = _radius(form), form.size_mm[2], axis_of(form)
    wall = turned(((radius * 0.25, _LIFT_MM), (radius, height * 0.25), (radius, height * 0.97)), at)
    cap = disc(radius * 1.08, height * 0.92, height, at)
    return Piece("glass", Role.GLASS, merged(wall)), Piece("cap", Role.BODY, merged(cap))


def _pump(form: Form) -> tuple[Piece, ...]:
    width, depth, height = form.size_mm
    at, (low, high) = syringe_axis(form), _stroke(form)
    housing = box((0.0, depth * 0.28, 0.0), (width, depth, height))
    foot = box((0.0, 0.0, 0.0), (width, depth * 0.28, height * 0.06))
    head = box((width * 0.2, 0.0, high), (width * 0.8, depth * 0.28, height))
    barrel = disc(width * 0.21, low, high, at)
    return (
        Piece("housing", Role.BODY, merged(housing)),
        Piece("head", Role.TOP, merged(head, foot)),
        Piece("slot", Role.DARK, merged(_slot(width, depth, height))),
        Piece("glass", Role.GLASS, merged(barrel)),
    )


def _slot(width: float, depth: float, height: float) -> trimesh.Trimesh:
    front = depth * 0.28 - 0.6
    return box((width * 0.44, front, height * 0.1), (width * 0.56, front + 0.8, height * 0.48))


def _valve(form: Form) -> tuple[Piece, ...]:
    width, depth, height = form.size_mm
    radius, at = min(width, height) * 0.46, (width / 2.0, height / 2.0)
    motor = box((0.0, depth * 0.4, 0.0), (width, depth, height))
    face = rod_towards_front(radius, at, depth * 0.12, depth * 0.4)
    hub = rod_towards_front(radius * 0.3, at, 0.0, depth * 0.12)
    return (
        Piece("motor", Role.BODY, merged(motor)),
        Piece("face", Role.TOP, merged(face)),
        Piece("hub", Role.DARK, merged(hub)),
    )


def _heater(form: Form) -> tuple[Piece, ...]:
    width, depth, height = form.size_mm
    at = form.top_at_mm or (width / 2.0, depth - width / 2.0)
    radius = min(width, depth) * 0.44
    housing = box((0.0, 0.0, 0.0), (width, depth, height * 0.9))
    plate = disc(radius, height * 0.9, height, at)
    knobs = [
        rod_towards_front(height * 0.17, (width * x, height * 0.42), -height * 0.1, 0.5)
        for x in (0.2, 0.8)
    ]
    display = box((width * 0.34, -0.8, height * 0.26), (width * 0.66, 0.5, height * 0.62))
    return (
        Piece("housing", Role.BODY, merged(housing)),
        Piece("plate", Role.TOP, merged(plate)),
        Piece("front", Role.DARK, merged(display, *knobs)),
    )


def _balance(form: Form) -> tuple[Piece, ...]:
    width, depth, height = form.size_mm
    at = form.top_at_mm or (width / 2.0, depth * 0.6)
    radius = min(width, depth) * 0.3
    housing = box((0.0, 0.0, 0.0), (width, depth, height * 0.84))
    stem = disc(radius * 0.3, height * 0.84, height * 0.95, at)
    pan = disc(radius, height * 0.94, height, at)
    display = box((width * 0.22, -0.8, height * 0.2), (width * 0.78, 0.5, height * 0.66))
    return (
        Piece("housing", Role.BODY, merged(housing)),
        Piece("pan", Role.TOP, merged(pan, stem)),
        Piece("display", Role.DARK, merged(display)),
    )


def _transmitter(form: Form) -> tuple[Piece, ...]:
    width, depth, height = form.size_mm
    housing = box((0.0, 0.0, 0.0), (width, depth, height))
    display = box((width * 0.12, -0.8, height * 0.4), (width * 0.58, 0.5, height * 0.85))
    sockets = [
        rod_towards_front(height * 0.12, (width * x, height * 0.3), -3.0, 0.5) for x in (0.7, 0.88)
    ]
    return (
        Piece("housing", Role.BODY, merged(housing)),
        Piece("front", Role.DARK, merged(display, *sockets)),
    )


@lru_cache(maxsize=128)
def probe(tip_mm: Offset, length_mm: float = 120.0) -> Mesh:
    """Build the probe of a transmitter, upright with its tip there."""
    x, y, z = tip_mm
    shaft = disc(3.5, z + 6.0, z + length_mm, (x, y))
    tip = turned(((1.5, z), (3.5, z + 6.0)), (x, y))
    head = disc(7.0, z + length_mm, z + length_mm + 22.0, (x, y))
    return merged(shaft, tip, head)


def _slab(form: Form) -> tuple[Piece, ...]:
    return (Piece("slab", Role.SLAB, merged(box((0.0, 0.0, 0.0), form.size_mm))),)


def _workstation(form: Form) -> tuple[Piece, ...]:
    width, depth, height = form.size_mm
    base = box((0.0, 0.0, 0.0), (width, depth, height * 0.12))
    posts = [
        box((x, depth - 25.0, height * 0.12), (x + 25.0, depth, height))
        for x in (0.0, width - 25.0)
    ]
    beam = box((0.0, depth - 30.0, height - 40.0), (width, depth, height))
    return Piece("base", Role.BODY, merged(base)), Piece("frame", Role.TOP, merged(beam, *posts))


def _ware(form: Form) -> tuple[Piece, ...]:
    width, depth, height = form.size_mm
    pieces = [Piece("ware", Role.BODY, merged(box((0.0, 0.0, 0.0), (width, depth, height))))]
    if form.cells_count:
        pieces.append(Piece("cells", Role.DARK, _cells(form)))
    return tuple(pieces)


def _cells(form: Form) -> Mesh:
    """Draw wells or tips as one surface, in the rows and columns that come nearest the ware."""
    width, depth, height = form.size_mm
    count = min(form.cells_count, _MOST_CELLS)
    rows = max(1, round((count * depth / width) ** 0.5))
    columns = -(-count // rows)
    step = min(width / columns, depth / rows)
    left, front = (width - step * (columns - 1)) / 2.0, (depth - step * (rows - 1)) / 2.0
    holes = []
    for number in range(count):
        x, y = left + step * (number % columns), front + step * (number // columns)
        holes.append(box((x - step * 0.33, y - step * 0.33, height - 0.5),
                         (x + step * 0.33, y + step * 0.33, height + 0.4)))  # fmt: skip
    return merged(*holes)


def _box(form: Form) -> tuple[Piece, ...]:
    width, depth, height = form.size_mm
    whole = box((0.0, 0.0, 0.0), (width, depth, height))
    strip = box((width * 0.1, -0.6, height * 0.72), (width * 0.9, 0.4, height * 0.8))
    return Piece("box", Role.BODY, merged(whole)), Piece("strip", Role.DARK, merged(strip))


_BODIES: dict[str, Callable[[Form], tuple[Piece, ...]]] = {
    "bench": _slab, "deck": _slab, "tray": _slab, "storage": _ware, "carrier": _ware,
    "plate": _ware, "tip_rack": _ware, "tube_rack": _ware,
    "bottle": _bottle, "flask": _flask, "reactor": _reactor, "waste": _waste,
    "vial": _tube, "tube": _tube, "vessel": _beaker, "trough": _beaker, "well": _beaker,
    "syringe_pump": _pump, "rotary_valve": _valve, "solenoid_valve": _valve,
    "heater_stirrer": _heater, "heater": _heater, "stirrer": _heater, "balance": _balance,
    "transmitter": _transmitter, "injection_valve": _valve,
    "workstation": _workstation, "liquid_handler": _workstation,
}  # fmt: skip
