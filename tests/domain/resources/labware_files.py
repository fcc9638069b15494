"""Small definitions that tests bend to their needs, and the published ones beside us."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

from labweb.domain.resources.labware.labware_definition import LabwareDefinition
from labweb.domain.resources.labware.opentrons_labware import parse_opentrons
from tests.corpus import LABWARE

OPENTRONS = LABWARE / "opentrons"
PYLABROBOT = LABWARE / "pylabrobot"

Json = dict[str, Any]


def load(path: Path) -> Any:  # noqa: ANN401 - JSON
    """Decode a file of the corpus."""
    raw = path.read_bytes()
    return json.loads(gzip.decompress(raw) if path.suffix == ".gz" else raw)


def an_opentrons_plate(**changes: object) -> Json:
    """A plate with two conical wells, A1 behind B1; schema 2."""
    well = {"shape": "circular", "diameter": 6.0, "depth": 10.0, "totalLiquidVolume": 250.5}
    well["geometryDefinitionId"] = "cone"
    cone = {"shape": "conical", "bottomDiameter": 4.0, "topDiameter": 6.0}
    return {
        "schemaVersion": 2,
        "metadata": {"displayName": "Two wells", "displayCategory": "wellPlate"},
        "parameters": {"isTiprack": False, "loadName": "two_wells"},
        "dimensions": {"xDimension": 40, "yDimension": 30, "zDimension": 14},
        "cornerOffsetFromSlot": {"x": 1, "y": 2, "z": 3},
        "ordering": [["A1", "B1"]],
        "wells": {
            "B1": {**well, "x": 10.0, "y": 8.0, "z": 2.5},
            "A1": {**well, "x": 10.0, "y": 20.0, "z": 2.5},
        },
        "groups": [],
        "innerLabwareGeometry": {
            "cone": {"sections": [{**cone, "bottomHeight": 0, "topHeight": 10}]}
        },
        **changes,
    }


def a_v3_plate(name: str = "flat", **features: object) -> Json:
    """A plate with one well whose origin is its back left bottom corner; schema 3."""
    return {
        "schemaVersion": 3,
        "metadata": {"displayName": name, "displayCategory": "wellPlate"},
        "parameters": {"isTiprack": False, "loadName": name},
        "extents": {
            "total": {
                "backLeftBottom": {"x": 0, "y": 0, "z": 0},
                "frontRightTop": {"x": 120, "y": -80, "z": 14},
            }
        },
        "features": features
        or {
            "slotFootprintAsChild": {
                "backLeft": {"x": 0, "y": 0},
                "frontRight": {"x": 120, "y": -80},
                "z": 0,
            }
        },
        "ordering": [["A1"]],
        "wells": {
            "A1": {
                **{"shape": "rectangular", "xDimension": 8, "yDimension": 6, "depth": 10},
                **{"totalLiquidVolume": 400, "x": 14, "y": -11, "z": 3.5},
            }
        },
        "groups": [],
    }


def published(name: str) -> LabwareDefinition:
    """A definition of the corpus, by the start of its file name."""
    (path,) = sorted(OPENTRONS.glob(f"v[23]/{name}_[0-9]*.json"))
    return parse_opentrons(load(path))
