"""Devices that a lab file lists as found and not yet admitted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab

STARTER = (Path(__file__).parents[4] / "fixtures/labs/starter/lab.json").read_bytes()


def starter(**changes: Any) -> bytes:  # noqa: ANN401 - JSON
    return json.dumps(json.loads(STARTER) | changes).encode()


def test_the_starter_lab_has_one_device_that_waits_for_an_admin() -> None:
    assert read_lab(STARTER).discovered == ("ph_1",)


def test_discovered_devices_are_written_back() -> None:
    lab = read_lab(starter(discovered=["timer_1", "ph_1"]))
    assert json.loads(render_lab(lab))["discovered"] == ["timer_1", "ph_1"]
    assert read_lab(render_lab(lab)) == lab


def test_a_lab_without_discovered_devices_does_not_name_the_field() -> None:
    assert "discovered" not in json.loads(render_lab(read_lab(starter(discovered=[]))))


@pytest.mark.parametrize(
    ("value", "code"),
    [
        (["nobody"], "lab_file.dangling"),
        (["ph_1", "ph_1"], "lab_file.duplicate"),
        ("ph_1", "lab_file.field"),
        ([7], "lab_file.field"),
    ],
)
def test_a_wrong_list_of_discovered_devices_is_refused(value: object, code: str) -> None:
    with pytest.raises(LabFileError) as refusal:
        read_lab(starter(discovered=value))
    found = [(finding.code, finding.context.get("field")) for finding in refusal.value.findings]
    assert found == [(code, "discovered")]
