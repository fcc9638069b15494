"""Definitions of labware that contradict themselves are refused, by field."""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import pytest

from labweb.domain.errors import DefinitionError
from labweb.domain.resources.labware.opentrons_labware import parse_opentrons


def a_plate() -> dict[str, Any]:
    """A plate of our own, four wells of 200 µL, without a brand."""
    wells = {
        f"{row}{column}": {
            "depth": 10.5, "totalLiquidVolume": 200, "shape": "circular", "diameter": 6.5,
            "x": 14.38 + 9 * (column - 1), "y": 74.24 - 9 * "AB".index(row), "z": 3.0,
        }
        for column in (1, 2)
        for row in "AB"
    }  # fmt: skip
    return {
        "ordering": [["A1", "B1"], ["A2", "B2"]],
        "brand": {},
        "metadata": {"displayName": "Own", "displayCategory": "wellPlate"},
        "dimensions": {"xDimension": 127.76, "yDimension": 85.48, "zDimension": 14.5},
        "wells": wells,
        "groups": [{"metadata": {}, "wells": list(wells)}],
        "parameters": {"format": "irregular", "isTiprack": False, "loadName": "own_4"},
        "namespace": "custom_beta",
        "version": 1,
        "schemaVersion": 2,
        "cornerOffsetFromSlot": {"x": 0, "y": 0, "z": 0},
    }


def well(address: str, **fields: object) -> Callable[[dict[str, Any]], None]:
    return lambda plate: plate["wells"][address].update(fields)


def test_a_plate_of_our_own_without_a_brand_is_read() -> None:
    assert len(parse_opentrons(a_plate()).wells) == 4


@pytest.mark.parametrize(
    ("spoil", "field"),
    [
        (well("A1", x=-20.0), "wells.A1.x"),
        (well("B2", y=120.0), "wells.B2.y"),
        (well("A1", z=-5.0), "wells.A1.z"),
        (well("A1", depth=60.0, totalLiquidVolume=100), "wells.A1.depth"),
        (well("A1", totalLiquidVolume=2000), "wells.A1.totalLiquidVolume"),
        (well("A2", x=17.0), "wells.A2"),
        (lambda plate: plate["parameters"].update(format="96Standard"), "parameters.format"),
        (lambda plate: plate["dimensions"].update(xDimension=20.0), "wells.A2.x"),
        (lambda plate: plate["dimensions"].update(zDimension="14,5"), "dimensions.zDimension"),
        (well("A1", diameter=-6.5), "wells.A1.diameter"),
        (well("A1", x=1e300), "wells.A1.x"),
    ],
)
def test_what_contradicts_itself_is_refused_by_field(
    spoil: Callable[[dict[str, Any]], None], field: str
) -> None:
    plate = a_plate()
    spoil(plate)
    with pytest.raises(DefinitionError) as refusal:
        parse_opentrons(json.loads(json.dumps(plate)))
    assert refusal.value.code == "labware.invalid"
    assert field in {finding.subject for finding in refusal.value.findings}


def test_all_contradictions_are_told_at_once() -> None:
    plate = deepcopy(a_plate())
    well("A1", totalLiquidVolume=2000)(plate)
    well("B2", y=120.0)(plate)
    plate["parameters"]["format"] = "96Standard"
    with pytest.raises(DefinitionError) as refusal:
        parse_opentrons(plate)
    assert {finding.subject for finding in refusal.value.findings} == {
        "wells.A1.totalLiquidVolume",
        "wells.B2.y",
        "parameters.format",
    }


def test_a_volume_a_little_above_the_drawing_is_within_the_tolerance() -> None:
    plate = a_plate()
    well("A1", totalLiquidVolume=360)(plate)
    assert parse_opentrons(plate).find_well("A1").capacity_nl == 360_000
