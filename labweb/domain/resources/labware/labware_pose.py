"""Where a piece of labware stands, and where its wells are then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from labweb.domain.errors import InfeasibleError
from labweb.domain.resources.labware.labware_definition import (
    ZERO,
    Footprint,
    LabwareDefinition,
    Seat,
    Vector,
    WellDefinition,
)
from labweb.domain.resources.labware.opentrons_deck import Slot
from labweb.domain.resources.labware.opentrons_seat import FLAT_LEFT, FLAT_RIGHT, LID
from labweb.domain.resources.pose import Pose, rotate


class WellAnchor(StrEnum):
    """A height within a well, on its axis."""

    BOTTOM = "bottom"
    CENTER = "center"
    TOP = "top"


@dataclass(frozen=True, slots=True, kw_only=True)
class Module:
    """A device in a slot that labware stands on."""

    model: str
    offset: Vector
    """Of the plane that labware stands on, from the corner of the slot as the module is there."""

    footprint: Footprint | None = None
    """The rectangle that labware stands on, where the module tells one."""

    side: Literal["left", "right"] | None = None
    """On which side of the deck it is turned to; a few adapters depend on it."""


def find_corner(
    stack: Sequence[LabwareDefinition], slot: Slot, module: Module | None = None
) -> Vector:
    """Return where the front left bottom corner of the topmost labware is, on the deck.

    Args:
        stack: Labware from the bottom up; the last is the one that is asked for.
        slot: Where the stack stands.
        module: What is between slot and stack, if anything.

    Raises:
        InfeasibleError: `labware.no_seat`: no definition says how the two fit together.

    Source:
        opentrons 10.1.0, `protocol_engine/state/labware_origin_math`. The corner offset of a
        definition of schema 2 counts for the topmost labware only, as there.
    """
    if not stack:
        raise InfeasibleError("there is no labware to find", code="labware.no_seat")
    corner = slot.corner if module is None else slot.corner.plus(module.offset)
    for place, labware in enumerate(stack):
        is_top = place == len(stack) - 1
        below = stack[place - 1] if place else None
        shift = (
            _on_deck(labware, slot, module)
            if below is None
            else _on_labware(labware, below, module)
        )
        corner = corner.plus(shift)
        if is_top:
            corner = corner.plus(labware.seat.corner_offset)
    return corner


def _on_deck(labware: LabwareDefinition, slot: Slot, module: Module | None) -> Vector:
    seat = labware.seat
    below = slot.footprint if module is None else module.footprint
    if seat.footprint is not None and below is not None:
        return _meet(below, seat.footprint)
    if seat.origin is not None:
        raise _no_seat(labware, slot.name if module is None else module.model)
    return ZERO if module is None else ZERO.minus(seat.on_module.get(module.model, ZERO))


def _on_labware(
    labware: LabwareDefinition, below: LabwareDefinition, module: Module | None
) -> Vector:
    joint = _joint(labware.seat, below.seat, module)
    if joint is not None:
        return joint
    if labware.seat.footprint is not None and below.seat.platform is not None:
        return _meet(below.seat.platform, labware.seat.footprint)
    overlap = _overlap(labware, below)
    shift = Vector(overlap.x_mm, overlap.y_mm, below.size.z_mm - overlap.z_mm)
    own, theirs = labware.seat.origin, below.seat.origin
    if own is not None and theirs is not None:
        return shift.plus(theirs).minus(own)
    if _overhangs(labware) or _overhangs(below):
        raise _no_seat(labware, below.name)
    return shift


def _overhangs(labware: LabwareDefinition) -> bool:
    """Tell whether labware reaches beyond the origin that its offsets count from."""
    origin = labware.seat.origin
    return origin is not None and origin != Vector(0.0, labware.size.y_mm, 0.0)


def _joint(seat: Seat, below: Seat, module: Module | None) -> Vector | None:
    names = [LID]
    if module is not None and module.side is not None:
        names.append(FLAT_LEFT if module.side == "left" else FLAT_RIGHT)
    for name in names:
        if name in seat.takes and name in below.gives:
            return below.gives[name].minus(seat.takes[name])
    return None


def _meet(parent: Footprint, child: Footprint) -> Vector:
    """Return the shift that lays one rectangle on the other: back left, or middle on middle."""
    z = parent.z_mm - child.z_mm
    if parent.is_pushed_to_back_left or child.is_pushed_to_back_left:
        return Vector(parent.left_mm - child.left_mm, parent.back_mm - child.back_mm, z)
    return Vector(
        (parent.left_mm + parent.right_mm - child.left_mm - child.right_mm) / 2,
        (parent.back_mm + parent.front_mm - child.back_mm - child.front_mm) / 2,
        z,
    )


def _overlap(labware: LabwareDefinition, below: LabwareDefinition) -> Vector:
    known = labware.seat.on_labware
    if below.name in known:
        return known[below.name]
    if "default" in known:
        return known["default"]
    if below.seat.gives_default and "default" in below.seat.on_labware:
        return below.seat.on_labware["default"]
    raise _no_seat(labware, below.name)


def _no_seat(labware: LabwareDefinition, below: str) -> InfeasibleError:
    return InfeasibleError(
        f"nothing says how {labware.label} stands on {below}: add an offset or a feature to "
        "its definition",
        code="labware.no_seat",
        context={"labware": labware.name, "below": below},
    )


def well_position(
    corner: Pose,
    well: WellDefinition,
    anchor: WellAnchor = WellAnchor.BOTTOM,
    offset: Vector = ZERO,
) -> Vector:
    """Return where a point of a well is in the frame in which the labware stands.

    Args:
        corner: Front left bottom corner of the labware and its attitude.
        well: Of that labware.
        anchor: Height on the axis of the well.
        offset: Shift from there, in the frame of the labware.
    """
    share = {WellAnchor.BOTTOM: 0.0, WellAnchor.CENTER: 0.5, WellAnchor.TOP: 1.0}[anchor]
    inside = well.bottom.plus(Vector(0.0, 0.0, share * well.depth_mm)).plus(offset)
    turned = Vector(*rotate(corner.rotation_wxyz, inside))
    return turned.plus(Vector(corner.x_mm, corner.y_mm, corner.z_mm))
