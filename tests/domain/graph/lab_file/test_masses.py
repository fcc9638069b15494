"""Solids and gases in a lab file: counted by mass, beside the liquids."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.resources.contents_by_lot import Phase

STARTER = Path(__file__).parents[4] / "fixtures" / "labs" / "starter" / "lab.json"


def a_lab(**flask: Any) -> bytes:  # noqa: ANN401
    """Give the starter lab a lot of salt, and some of it to flask 1."""
    value = json.loads(STARTER.read_bytes())
    salt = {"key": "salt", "name": "Salt", "groups": ["halide"], "incompatible_with": ["acid"]}
    value["materials"].append(salt)
    value["lots"].append({"key": "salt 1", "material": "salt", "phase": "solid"})
    entry = next(entry for entry in value["resources"] if entry["key"] == "flask_1")
    entry |= flask
    entry["config"] = entry["config"] | {"capacity_mg": 50}
    return json.dumps(value).encode()


def salt(amount_mg: float) -> list[dict[str, Any]]:
    return [{"lot": "salt 1", "amount_mg": amount_mg}]


def test_a_solid_is_read_in_whole_micrograms_and_written_back() -> None:
    lab = read_lab(a_lab(masses=salt(12.345)))
    lot = next(lot for lot in lab.lots if lot.key == "salt 1")
    assert lot.phase is Phase.SOLID
    assert [list(held.values()) for held in lab.masses.values()] == [[12_345]]
    assert lab.materials_by_id[lot.material_id].incompatible_with == ("acid",)
    assert read_lab(render_lab(lab)) == lab


@pytest.mark.parametrize(
    ("flask", "code"),
    [
        ({"masses": salt(0.0001)}, "lab_file.off_grid"),
        ({"masses": salt(51)}, "lab_file.overfull"),
        ({"masses": salt(1) * 2}, "lab_file.duplicate"),
        ({"masses": [{"lot": "none", "amount_mg": 1}]}, "lab_file.dangling"),
        ({"contents": [{"lot": "salt 1", "amount_ul": 1}]}, "lab_file.phase"),
    ],
)
def test_a_mass_that_cannot_be_is_refused(flask: dict[str, Any], code: str) -> None:
    with pytest.raises(LabFileError) as refusal:
        read_lab(a_lab(**flask))
    assert [finding.code for finding in refusal.value.findings] == [code]
