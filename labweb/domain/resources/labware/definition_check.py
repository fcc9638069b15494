"""Whether a definition of labware can be true: geometry, volumes and names against each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping

from labweb.domain.resources.labware.labware_definition import LabwareDefinition, WellDefinition
from labweb.domain.resources.labware.well_geometry import capacity_ul, depth_mm

TOLERANCE_MM = 1.0
"""By so much makers' own drawings differ from their outer sizes; more is a mistake."""

OVERLAP_MM = 0.1
"""By so much two wells may reach into each other, by rounding."""

TOLERANCE_RATIO = 0.05
"""By so much the volume that is printed on a well may exceed what its shape holds."""

INSIDE_RATIO = 0.3
"""By so much it may exceed the drawn inside, which is drawn simpler than it is."""

NOMINAL: Mapping[str, tuple[int, int]] = {"96Standard": (8, 12), "384Standard": (16, 24)}
"""Rows and columns of formats that name them.

Source:
    opentrons-shared-data, `parameters.format`; ANSI/SLAS 4-2004.
"""

_CLOSED = frozenset({"plate", "reservoir"})
"""Kinds whose wells are cut into them; tubes stand out of a rack."""

Problem = tuple[str, str]
"""Field by its path in the file, and what is wrong with it."""


def check_definition(
    labware: LabwareDefinition, layout: str = "", *, is_block: bool = False
) -> list[Problem]:
    """List every field that contradicts another one; an empty list means that none does.

    Args:
        labware: What was read.
        layout: Format that the definition names for its wells; empty: none.
        is_block: What stands in it is described with it, and may stand out of it.
    """
    if labware.kind in {"waste", "foreign"}:
        return []
    return [
        *(problem for well in labware.wells for problem in _check_well(labware, well)),
        *([] if is_block or labware.kind not in _CLOSED else _check_tops(labware)),
        *_check_overlaps(labware),
        *_check_layout(labware, layout),
        *_check_tip(labware),
    ]


def _check_well(labware: LabwareDefinition, well: WellDefinition) -> Iterator[Problem]:
    at, corner, size = f"wells.{well.address}", well.corner, labware.size
    for axis, low, high, most in (
        ("x", corner.x_mm, corner.x_mm + well.x_size_mm, size.x_mm),
        ("y", corner.y_mm, corner.y_mm + well.y_size_mm, size.y_mm),
    ):
        if low < -TOLERANCE_MM or high > most + TOLERANCE_MM:
            yield (
                f"{at}.{axis}",
                f"puts the well at {low:g} to {high:g} mm, outside of the labware, which is "
                f"{most:g} mm wide there",
            )
    if labware.kind == "tip_rack":
        # A tip hangs through its rack: its floor is below, and its volume is the tip's.
        return
    if well.bottom.z_mm < -TOLERANCE_MM:
        yield f"{at}.z", f"puts the floor of the well {-well.bottom.z_mm:g} mm below the labware"
    yield from _check_volume(at, well)


def _check_tops(labware: LabwareDefinition) -> Iterator[Problem]:
    for well in labware.wells:
        if well.top.z_mm > labware.size.z_mm + TOLERANCE_MM:
            yield (
                f"wells.{well.address}.depth",
                f"puts the top of the well at {well.top.z_mm:g} mm, above the labware, which is "
                f"{labware.size.z_mm:g} mm high",
            )


def _check_volume(at: str, well: WellDefinition) -> Iterator[Problem]:
    stated_ul = (well.capacity_nl or 0) / 1000
    area = well.x_size_mm * well.y_size_mm * (math.pi / 4 if well.is_round else 1.0)
    drawn = [("the box or cylinder around it", area * well.depth_mm, TOLERANCE_RATIO)]
    if well.cavity is not None:
        drawn.append(("its inner geometry", capacity_ul(well.cavity), INSIDE_RATIO))
        if depth_mm(well.cavity) > well.depth_mm + TOLERANCE_MM:
            yield (
                f"{at}.geometryDefinitionId",
                f"names an inside {depth_mm(well.cavity):g} mm deep, in a well of "
                f"{well.depth_mm:g} mm",
            )
    for what, holds_ul, tolerance in drawn:
        if stated_ul > holds_ul * (1 + tolerance):
            yield (
                f"{at}.totalLiquidVolume",
                f"is {stated_ul:g} µL, and {what} holds {holds_ul:.4g} µL",
            )


def _check_overlaps(labware: LabwareDefinition) -> Iterator[Problem]:
    """Yield each pair of wells that reach into each other; those far apart are not compared."""
    wells = sorted(labware.wells, key=lambda well: well.corner.x_mm)
    widest = max((well.x_size_mm for well in wells), default=0.0)
    for index, one in enumerate(wells):
        for other in itertools.islice(wells, index + 1, None):
            if other.corner.x_mm >= one.corner.x_mm + widest:
                break
            overlap = _overlap_mm(one, other)
            if overlap > OVERLAP_MM:
                text = f"overlaps well {one.address} by {overlap:.3g} mm"
                yield f"wells.{other.address}", text


def _overlap_mm(one: WellDefinition, other: WellDefinition) -> float:
    x, y = (abs(a - b) for a, b in zip(one.bottom[:2], other.bottom[:2], strict=True))
    if one.is_round and other.is_round:
        return (one.x_size_mm + other.x_size_mm) / 2 - math.hypot(x, y)
    sides = (one.x_size_mm + other.x_size_mm, one.y_size_mm + other.y_size_mm)
    return min(sides[0] / 2 - x, sides[1] / 2 - y)


def _check_layout(labware: LabwareDefinition, layout: str) -> Iterator[Problem]:
    if layout not in NOMINAL or not labware.wells:
        return
    rows, columns = NOMINAL[layout]
    nominal = {
        f"{chr(ord('A') + row)}{column + 1}" for row in range(rows) for column in range(columns)
    }
    own = set(labware.wells_by_address)
    if own != nominal:
        odd = sorted(own ^ nominal)[:5]
        text = f"is {layout}, which is {rows} rows × {columns} columns; not so: {', '.join(odd)}"
        yield "parameters.format", text


def _check_tip(labware: LabwareDefinition) -> Iterator[Problem]:
    tip = labware.tip
    if tip is not None and tip.overlap_mm is not None and tip.overlap_mm >= tip.length_mm:
        text = f"is {tip.overlap_mm:g} mm, and the whole tip is {tip.length_mm:g} mm long"
        yield "parameters.tipOverlap", text
