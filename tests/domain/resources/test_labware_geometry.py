"""Volume by height and height by volume, for every shape that definitions know."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.errors import InfeasibleError
from labweb.domain.resources.labware.well_geometry import (
    Cavity,
    Conical,
    Cuboidal,
    RoundedCuboid,
    Section,
    Spherical,
    SquaredCone,
    Table,
    capacity_ul,
    check_cavity,
    level_mm,
    volume_ul,
)

SHAPES: dict[str, Section] = {
    "spherical": Spherical(bottom_mm=0, top_mm=3, radius_mm=4),
    "conical": Conical(bottom_mm=0, top_mm=9, bottom_diameter_mm=2, top_diameter_mm=7),
    "conical, narrower at the top": Conical(
        bottom_mm=0, top_mm=9, bottom_diameter_mm=7, top_diameter_mm=2, count=3
    ),
    "a tip of a cone": Conical(bottom_mm=0, top_mm=5, bottom_diameter_mm=0, top_diameter_mm=4),
    "cuboidal": Cuboidal(
        bottom_mm=0, top_mm=8, bottom_x_mm=2, bottom_y_mm=9, top_x_mm=6, top_y_mm=4, count=12
    ),
    "squared cone": SquaredCone(
        bottom_mm=0, top_mm=5, diameter_mm=4, x_mm=8.2, y_mm=6.4, circle="bottom"
    ),
    "squared cone, circle on top": SquaredCone(
        bottom_mm=0, top_mm=5, diameter_mm=4, x_mm=8.2, y_mm=6.4, circle="top"
    ),
    "rounded cuboid": RoundedCuboid(
        bottom_mm=0, top_mm=4, diameter_mm=5, x_mm=8, y_mm=6, circle="bottom"
    ),
    "rounded cuboid, circle on top": RoundedCuboid(
        bottom_mm=0, top_mm=4, diameter_mm=8, x_mm=8, y_mm=8, circle="top"
    ),
}


def area_mm2(section: Section, level: float) -> float:
    """Measure a cross-section by what the shape is, not by the volume formulas."""
    t = level / (section.top_mm - section.bottom_mm)
    match section:
        case Spherical():
            return math.pi * (section.radius_mm**2 - (section.radius_mm - level) ** 2)
        case Conical():
            low, high = section.bottom_diameter_mm, section.top_diameter_mm
            return math.pi / 4 * (low + (high - low) * t) ** 2 * section.count
        case Cuboidal():
            x = section.bottom_x_mm + (section.top_x_mm - section.bottom_x_mm) * t
            y = section.bottom_y_mm + (section.top_y_mm - section.bottom_y_mm) * t
            return x * y * section.count
        case SquaredCone():
            share = t if section.circle == "bottom" else 1 - t
            start, end = section.diameter_mm / 2, math.hypot(section.x_mm, section.y_mm) / 2
            return _circle_in_box(start + (end - start) * share, section.x_mm, section.y_mm)
        case RoundedCuboid():
            share = t if section.circle == "bottom" else 1 - t
            r = section.diameter_mm / 2 * (1 - share)
            x, y = section.x_mm * share + 2 * r, section.y_mm * share + 2 * r
            return x * y - (4 - math.pi) * r**2
        case Table():
            raise AssertionError
    raise AssertionError


def _circle_in_box(r: float, x: float, y: float) -> float:
    """Add up strips of the box, each cut at the circle."""
    steps = 400
    width = min(x / 2, r) / steps
    heights = (min(y / 2, math.sqrt(max(r**2 - ((k + 0.5) * width) ** 2, 0))) for k in range(steps))
    return 4 * width * sum(heights)


@pytest.mark.parametrize("name", SHAPES)
def test_a_volume_is_the_sum_of_the_cross_sections_below_the_level(name: str) -> None:
    section = SHAPES[name]
    steps = 200
    for share in (0.3, 0.75, 1.0):
        level = section.top_mm * share
        slices = (area_mm2(section, (k + 0.5) * level / steps) for k in range(steps))
        summed = sum(slices) * level / steps
        assert volume_ul((section,), level) == pytest.approx(summed, rel=2e-4), (name, share)


@pytest.mark.parametrize("name", SHAPES)
def test_the_level_of_a_volume_leads_back_to_it(name: str) -> None:
    cavity = (SHAPES[name],)
    for share in (0.0, 0.01, 0.4, 0.99):
        amount_nl = int(capacity_ul(cavity) * 1000 * share)
        back_nl = volume_ul(cavity, level_mm(cavity, amount_nl)) * 1000
        assert back_nl == pytest.approx(amount_nl, abs=1e-3)


def test_sections_add_up_and_a_level_is_found_in_the_right_one() -> None:
    """spherical 0 to 2 mm, conical 2 to 10 mm, cuboidal 10 to 12 mm"""
    cavity: Cavity = (
        Spherical(bottom_mm=0, top_mm=2, radius_mm=3),
        Conical(bottom_mm=2, top_mm=10, bottom_diameter_mm=5, top_diameter_mm=6),
        Cuboidal(bottom_mm=10, top_mm=12, bottom_x_mm=7, bottom_y_mm=7, top_x_mm=7, top_y_mm=7),
    )
    assert check_cavity(cavity) == []
    cap = math.pi * 4 * 7 / 3
    frustum = math.pi * 8 / 12 * (25 + 30 + 36)
    assert volume_ul(cavity, 2) == pytest.approx(cap)
    assert volume_ul(cavity, 11) == pytest.approx(cap + frustum + 49)
    assert level_mm(cavity, round((cap + frustum + 49) * 1000)) == pytest.approx(11, abs=1e-4)


@given(st.floats(0, 1), st.floats(0, 1), st.sampled_from(sorted(SHAPES)))
def test_more_liquid_never_stands_lower(one: float, other: float, name: str) -> None:
    cavity = (SHAPES[name],)
    low, high = sorted((one, other))
    top = cavity[0].top_mm
    assert volume_ul(cavity, low * top) <= volume_ul(cavity, high * top) + 1e-9
    nl = capacity_ul(cavity) * 1000
    assert level_mm(cavity, int(low * nl)) <= level_mm(cavity, int(high * nl)) + 1e-9


def test_a_table_is_read_between_its_points() -> None:
    table = (Table(bottom_mm=0, top_mm=4, points=((0, 0), (1, 50), (4, 350))),)
    assert check_cavity(table) == []
    assert volume_ul(table, 0.5) == 25
    assert volume_ul(table, 2.5) == 200
    assert level_mm(table, 200_000) == pytest.approx(2.5)


@pytest.mark.parametrize("height_mm", [-0.1, 9.1, math.nan, math.inf])
def test_a_level_outside_the_well_has_no_volume(height_mm: float) -> None:
    with pytest.raises(InfeasibleError) as refused:
        volume_ul((SHAPES["conical"],), height_mm)
    assert refused.value.code == "labware.level"


def test_an_amount_that_does_not_go_in_has_no_level() -> None:
    cavity = (SHAPES["conical"],)
    for amount_nl in (-1, math.ceil(capacity_ul(cavity) * 1000) + 1):
        with pytest.raises(InfeasibleError):
            level_mm(cavity, amount_nl)


@pytest.mark.parametrize(
    ("sections", "problem"),
    [
        ((), "1 to 1000 sections"),
        ((Spherical(bottom_mm=0, top_mm=0, radius_mm=1),), "no height"),
        ((Spherical(bottom_mm=0, top_mm=3, radius_mm=1),), "higher than its sphere"),
        ((Spherical(bottom_mm=1, top_mm=2, radius_mm=3),), "does not start at 0"),
        ((SHAPES["conical"], SHAPES["spherical"]), "does not start at 9"),
        (
            (Conical(bottom_mm=0, top_mm=1, bottom_diameter_mm=0, top_diameter_mm=0),),
            "both its diameters",
        ),
        (
            (SquaredCone(bottom_mm=0, top_mm=1, diameter_mm=9, x_mm=3, y_mm=4, circle="top"),),
            "larger than its rectangle",
        ),
        (
            (RoundedCuboid(bottom_mm=0, top_mm=1, diameter_mm=9, x_mm=0, y_mm=4, circle="top"),),
            "no area",
        ),
        ((Table(bottom_mm=0, top_mm=2, points=((0, 0), (2, 5), (1, 9))),), "must both rise"),
        ((Table(bottom_mm=0, top_mm=2, points=((0, 1), (2, 5))),), "starts at zero"),
    ],
)
def test_sections_that_are_no_cavity_are_told(sections: Cavity, problem: str) -> None:
    assert any(problem in found for found in check_cavity(sections))


def test_a_squared_cone_whose_circle_is_as_wide_as_its_box_is_the_box() -> None:
    box = SquaredCone(bottom_mm=0, top_mm=2, diameter_mm=5, x_mm=3, y_mm=4, circle="bottom")
    assert check_cavity((box,)) == []
    assert volume_ul((box,), 0.5) == pytest.approx(6)


def test_a_full_well_is_full_to_its_top() -> None:
    cube = Cuboidal(bottom_mm=0, top_mm=5, bottom_x_mm=2, bottom_y_mm=2, top_x_mm=2, top_y_mm=2)
    assert level_mm((cube,), 20_000) == pytest.approx(5)
