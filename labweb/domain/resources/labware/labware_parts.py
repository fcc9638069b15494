"""A piece of labware, or a place for one, with all that stands in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from labweb.domain.errors import DefinitionError, Finding
from labweb.domain.resources.labware.definition_check import check_definition
from labweb.domain.resources.labware.foreign_json import MAX_FINDINGS
from labweb.domain.resources.labware.labware_definition import (
    LabwareDefinition,
    TipDefinition,
    Vector,
    WellDefinition,
)
from labweb.domain.resources.labware.well_geometry import Cavity
from labweb.domain.resources.pose import Pose, compose, rotate

HERE = Pose(0.0, 0.0, 0.0)
"""Pose of a thing in its own frame."""


@dataclass(frozen=True, kw_only=True)
class LabwarePart:
    """One node of such a tree.

    Frame:
        Placed by its front left bottom corner in the frame of its parent.
    """

    name: str
    """Unique in its tree."""

    label: str
    kind: str
    type: str
    """Class that it had where it comes from."""

    size: Vector
    pose: Pose | None = None
    """None: nobody says where it stands."""

    capacity_nl: int | None = None
    is_round: bool = False
    cavity: Cavity | None = None
    tip: TipDefinition | None = None
    addresses: Mapping[str, str] = field(default_factory=dict)
    """Address of a child by the child's name, such as `A1`."""

    children: tuple[LabwarePart, ...] = ()


def walk(part: LabwarePart, above: Pose | None = HERE) -> Iterator[tuple[LabwarePart, Pose | None]]:
    """Yield every part with its pose in the frame that the outermost one stands in.

    The pose is None for a part whose place nobody tells, and for all that stands in it. The
    outermost part may be without a place: it then stands at the origin.
    """
    pose = part.pose if part.pose is not None or above is not HERE else HERE
    stack: list[tuple[LabwarePart, Pose | None]] = [(part, _placed(above, pose))]
    while stack:
        current, at = stack.pop()
        yield current, at
        stack.extend((child, _placed(at, child.pose)) for child in reversed(current.children))


def _placed(above: Pose | None, pose: Pose | None) -> Pose | None:
    return None if above is None or pose is None else compose(above, pose)


def find_bottoms(part: LabwarePart) -> dict[str, Vector | None]:
    """Return the middle of the bottom of every part, in the frame of the outermost one.

    A part whose place nobody tells has None.
    """
    return {found.name: _bottom(found, pose) for found, pose in walk(part)}


def _bottom(part: LabwarePart, pose: Pose | None) -> Vector | None:
    if pose is None:
        return None
    middle = (part.size.x_mm / 2, part.size.y_mm / 2, 0.0)
    corner = Vector(pose.x_mm, pose.y_mm, pose.z_mm)
    return corner.plus(Vector(*rotate(pose.rotation_wxyz, middle)))


def definition_of(part: LabwarePart) -> LabwareDefinition:
    """Return the definition of one piece of labware that stands in such a tree.

    A lid on it is a thing of its own and left out.

    Raises:
        DefinitionError: `labware.invalid`: a well of it has no address or no place, or is
            turned against the labware.
    """
    findings: list[Finding] = []
    inside = [child for child in part.children if child.kind != "lid"]
    wells = tuple(well for child in inside if (well := _well(part, child, findings)) is not None)
    kinds = {child.kind for child in inside}
    if len(kinds) > 1:
        findings.append(
            Finding("labware.kind", f"{part.name} holds {', '.join(sorted(kinds))}", part.name)
        )
    if findings:
        raise DefinitionError(
            f"{part.name} is no labware: {findings[0].message}",
            code="labware.invalid",
            findings=findings,
        )
    made = LabwareDefinition(
        name=part.label,
        label=part.label,
        kind=part.kind,
        well_kind=next(iter(kinds), None),
        source="pylabrobot",
        size=part.size,
        wells=wells,
        tip=next((child.tip for child in inside if child.tip is not None), None),
    )
    wrong = [
        Finding("labware.contradiction", f"{part.name}, {field}: {problem}", part.name)
        for field, problem in check_definition(made)
    ]
    if wrong:
        raise DefinitionError(
            f"{part.name} is no labware: {wrong[0].message}",
            code="labware.invalid",
            findings=wrong[:MAX_FINDINGS],
        )
    return made


def _well(part: LabwarePart, child: LabwarePart, findings: list[Finding]) -> WellDefinition | None:
    address = part.addresses.get(child.name)
    if address is None:
        findings.append(Finding("labware.address", f"{child.name} has no address", child.name))
    if child.pose is None:
        findings.append(Finding("labware.no_place", f"{child.name} has no place", child.name))
    elif abs(child.pose.rotation_wxyz[0]) < 1.0:
        findings.append(
            Finding("labware.rotation", f"{child.name} is turned in its labware", child.name)
        )
    if address is None or child.pose is None:
        return None
    corner = Vector(child.pose.x_mm, child.pose.y_mm, child.pose.z_mm)
    return WellDefinition(
        address=address,
        bottom=corner.plus(Vector(child.size.x_mm / 2, child.size.y_mm / 2, 0.0)),
        x_size_mm=child.size.x_mm,
        y_size_mm=child.size.y_mm,
        depth_mm=child.size.z_mm,
        is_round=child.is_round,
        capacity_nl=child.capacity_nl,
        cavity=child.cavity,
    )
