"""Every step and property of the published table is read and written, in every version."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from labweb.domain.errors import ProtocolError
from labweb.domain.recipes.xdl.file_format.read_xdl import read_xdl
from labweb.domain.recipes.xdl.file_format.write_xdl import VERSIONS, render_as, render_xdl
from labweb.domain.recipes.xdl.tables.step_spec import METADATA, REAGENT, STEPS, Property
from labweb.domain.recipes.xdl.tables.step_table import PARENTS
from tests.corpus import NO_XDL, XDL

PUBLISHED = XDL / "xdl_step_table.json"
RESTATED = XDL.parents[1] / "reference/xdl.md"
SECTIONS: Mapping[str, Mapping[str, Property]] = {"Metadata": METADATA, "Reagent": REAGENT}
SINCE_2: Mapping[str, str] = {
    "Add": "amount",
    "Transfer": "amount solid",
    "Dissolve": "amount",
    "Precipitate": "amount",
    "Irradiate": "color LED_power LED_intensity cooling_power",
    "Monitor": "target quantity min max",
}
"""What XDL 2.0 added, by the restated table."""

NOT_REQUIRED = {("Add", "volume"), ("AddSolid", "mass"), ("Dissolve", "volume")} | {
    ("Transfer", "volume"),
    ("WashSolid", "volume"),
    ("Irradiate", "wavelength"),
    ("Reagent", "name"),
    ("Repeat", "repeats"),
    ("Callback", "args"),
    ("Callback", "keyword_args"),
}
"""Required in 0.5, and one of several ways to say it since; or left out by published recipes."""

WRITTEN: Mapping[str, str] = {
    "vessel": "reactor",
    "reagent": "water",
    "through": "silica",
    "gas": "argon",
    "pid": "one",
    "text": "words",
    "bool": "True",
    "stirring": "solvent",
    "count": "2",
    "number": "3",
    "volume": "5 mL",
    "volume_or_all": "5 mL",
    "mass": "2 g",
    "moles": "2 mmol",
    "amount": "2 mmol",
    "amount_or_all": "5 mL",
    "time": "5 min",
    "temperature": "30 °C",
    "pressure": "50 mbar",
    "rotation": "300 RPM",
    "flow": "4 mL/min",
    "wavelength": "450 nm",
    "power": "5 W",
    "percent": "50 %",
}
"""A text of each sort."""


def published() -> list[dict[str, Any]]:
    """Return the table that the reference compiler's templates make."""
    if not (PUBLISHED.exists() and RESTATED.exists()):
        if os.environ.get("CI", "").lower() == "true":
            pytest.fail(NO_XDL)
        pytest.skip(NO_XDL)
    found: list[dict[str, Any]] = json.loads(PUBLISHED.read_text("utf-8"))["steps"]
    return found


def known(name: str) -> Mapping[str, Property] | None:
    spec = STEPS.spec(name)
    return SECTIONS.get(name) if spec is None else spec.properties


def text_of(one: Property) -> str:
    return one.choices[0] if one.choices else WRITTEN[one.sort]


def faults_of(entry: dict[str, Any]) -> Iterator[str]:
    """Say what the table has of one element and we have not, or otherwise."""
    name, ours = entry["name"], known(entry["name"])
    if ours is None:
        yield f"{name} is not known"
        return
    for param in entry["params"]:
        own, at = ours.get(param["name"]), (name, param["name"])
        if param["name"] == "children":
            if name not in PARENTS:
                yield f"{name} holds no steps"
        elif own is None:
            yield f"{at} is not known"
        elif own.is_required != (param["required"] and at not in NOT_REQUIRED):
            yield f"{at}: required is {own.is_required}"
        elif param["default"] not in (None, "None") and own.default != param["default"].strip("'"):
            yield f"{at}: default is {own.default}"


def test_every_step_and_property_of_the_published_table_is_known() -> None:
    assert [fault for entry in published() for fault in faults_of(entry)] == []


def test_every_step_of_the_restated_table_is_known_and_what_2_0_added() -> None:
    published()
    text = RESTATED.read_text("utf-8").partition("### 1.4")[2].partition("### 1.5")[0]
    rows = re.findall(r"^\| ([A-Z]\w+(?:, [A-Z]\w+)*) \|", text, re.MULTILINE)
    names = [name for row in rows for name in row.split(", ")]
    assert len(names) > 30
    assert [name for name in names if STEPS.spec(name) is None] == []
    for name, added in SINCE_2.items():
        spec = STEPS.spec(name)
        assert spec is not None
        assert set(added.split()) <= set(spec.properties), name
    assert all({"comment", "queue"} <= set(spec.properties) for spec in STEPS.steps.values())


def recipes(entry: dict[str, Any]) -> Iterator[str]:
    """Write a step with all its properties of 0.5, and one with the least of them."""
    name, ours = entry["name"], known(entry["name"]) or {}
    params = [ours[p["name"]] for p in entry["params"] if p["name"] in ours]
    least = [one for one in params if one.is_required or (name, one.name) in NOT_REQUIRED]
    for chosen in (params, least):
        said = " ".join(f'{one.name}="{text_of(one)}"' for one in chosen)
        inside = '<Wait time="1 s"/>' if name in PARENTS else ""
        begun = '<Async pid="one"><Wait time="1 s"/></Async>' if name == "Await" else ""
        yield f"{begun}<{name} {said}>{inside}</{name}>"


def whole(step: str, version: str) -> str:
    names = "name" if version not in {"0.3", "0.4"} else "id"
    reagents = "".join(f'<Reagent {names}="{one}"/>' for one in ("water", "silica"))
    return (
        f'<?xdl version="{version}"?><Synthesis><Hardware><Component id="reactor" type="reactor"/>'
        f"</Hardware><Reagents>{reagents}</Reagents><Procedure>{step}</Procedure></Synthesis>"
    )


@pytest.mark.parametrize("version", VERSIONS)
def test_every_step_is_read_in_every_version_and_written_in_every_other(version: str) -> None:
    entries = [entry for entry in published() if STEPS.spec(entry["name"]) is not None]
    count = 0
    for entry in entries:
        for step in recipes(entry):
            recipe = read_xdl(whole(step, version).encode())
            assert render_xdl(recipe) == render_xdl(read_xdl(render_xdl(recipe).encode()))
            for other in VERSIONS:
                again = read_xdl(render_as(recipe, other).encode())
                as_json = read_xdl(render_as(recipe, version).encode())
                assert again.synthesis.steps == recipe.synthesis.steps, (entry["name"], other)
                assert as_json.synthesis.steps == recipe.synthesis.steps
                count += 1
    assert count > 300


def test_what_2_0_added_is_refused_by_an_older_version_and_never_dropped() -> None:
    published()
    step = '<Add vessel="reactor" reagent="water" amount="5 mL"/>'
    recipe = read_xdl(whole(step, "2.0").encode())
    for older in VERSIONS:
        if older in {"1.0", "2.0"}:
            assert 'amount="5 mL"' in render_as(recipe, older)
            continue
        with pytest.raises(ProtocolError) as refusal:
            render_as(recipe, older)
        assert [finding.code for finding in refusal.value.findings] == ["xdl.not_in_version"]
