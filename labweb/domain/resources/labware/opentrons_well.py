"""Read the inner geometry of wells from a definition of Opentrons."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from labweb.domain.resources.labware.foreign_json import JsonReader
from labweb.domain.resources.labware.well_geometry import (
    MAX_SECTIONS,
    Cavity,
    Conical,
    Cuboidal,
    RoundedCuboid,
    Section,
    Spherical,
    SquaredCone,
    Table,
    check_cavity,
)

MAX_CAVITIES = 1_000

_SHAPES = ("spherical", "conical", "cuboidal", "squaredcone", "roundedcuboid")


def read_cavities(reader: JsonReader) -> dict[str, Cavity]:
    """Return the cavities of `innerLabwareGeometry` by id; what is wrong becomes a finding."""
    if not reader.has("innerLabwareGeometry"):
        return {}
    found = {}
    for name, geometry in reader.entries("innerLabwareGeometry", MAX_CAVITIES):
        read = _read_table if "heightToVolumeMap" in geometry.value else _read_sections
        before = len(reader.findings)
        sections = read(geometry)
        if len(reader.findings) == before:
            for problem in check_cavity(sections):
                geometry.refuse("labware.geometry", problem)
        found[name] = sections
    return found


def _read_sections(geometry: JsonReader) -> Cavity:
    sections = [_read_section(section) for section in geometry.objects("sections", MAX_SECTIONS)]
    return tuple(sorted(sections, key=lambda section: section.bottom_mm))


def _read_table(geometry: JsonReader) -> Cavity:
    points = sorted(
        (point.number("height"), point.number("volume", high=1e12))
        for point in geometry.objects("heightToVolumeMap", MAX_SECTIONS)
    )
    if points and points[0][0] > 0:
        points.insert(0, (0.0, 0.0))
    top = points[-1][0] if points else 0.0
    return (Table(bottom_mm=0.0, top_mm=top, points=tuple(points)),)


def _read_section(section: JsonReader) -> Section:
    shape = section.choice("shape", _SHAPES)
    return _READERS.get(shape, _read_spherical)(section) if shape else _nothing(section)


def _nothing(section: JsonReader) -> Section:
    return Spherical(bottom_mm=section.number("bottomHeight"), top_mm=0.0, radius_mm=0.0)


def _count(section: JsonReader) -> int:
    return section.count("xCount", 1) * section.count("yCount", 1)


def _read_spherical(section: JsonReader) -> Section:
    return Spherical(
        bottom_mm=section.number("bottomHeight"),
        top_mm=section.number("topHeight"),
        radius_mm=section.number("radiusOfCurvature"),
        count=_count(section),
    )


def _read_conical(section: JsonReader) -> Section:
    return Conical(
        bottom_mm=section.number("bottomHeight"),
        top_mm=section.number("topHeight"),
        bottom_diameter_mm=section.number("bottomDiameter"),
        top_diameter_mm=section.number("topDiameter"),
        count=_count(section),
    )


def _read_cuboidal(section: JsonReader) -> Section:
    return Cuboidal(
        bottom_mm=section.number("bottomHeight"),
        top_mm=section.number("topHeight"),
        bottom_x_mm=section.number("bottomXDimension"),
        bottom_y_mm=section.number("bottomYDimension"),
        top_x_mm=section.number("topXDimension"),
        top_y_mm=section.number("topYDimension"),
        count=_count(section),
    )


def _read_mixed(section: JsonReader) -> Section:
    is_squared = section.value["shape"] == "squaredcone"
    below = section.choice("bottomCrossSection", ("circular", "rectangular"))
    return (SquaredCone if is_squared else RoundedCuboid)(
        bottom_mm=section.number("bottomHeight"),
        top_mm=section.number("topHeight"),
        diameter_mm=section.number("circleDiameter"),
        x_mm=section.number("rectangleXDimension"),
        y_mm=section.number("rectangleYDimension"),
        circle="bottom" if below == "circular" else "top",
        count=_count(section),
    )


_READERS: Mapping[str, Callable[[JsonReader], Section]] = {
    "spherical": _read_spherical,
    "conical": _read_conical,
    "cuboidal": _read_cuboidal,
    "squaredcone": _read_mixed,
    "roundedcuboid": _read_mixed,
}
