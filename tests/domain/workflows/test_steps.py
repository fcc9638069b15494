from __future__ import annotations

import json

import pytest
from jsonschema import Draft202012Validator

from labweb.domain.dimensions import DIMENSIONS
from labweb.domain.workflows.unit_operations.step_palette import (
    STEP_KINDS,
    PortKind,
    palette,
    sentence,
    sentence_text,
)

NAMES = {"w": "Water", "r": "Reactor 1", "p": "Pump 2", "b": "Balance"}


def test_a_transfer_says_what_from_where_to_where() -> None:
    parts = sentence("transfer", {"source": "w", "target": "r", "volume": "5  mL"}, NAMES)
    assert [(part["text"], part["strong"]) for part in parts] == [
        ("Transfer ", False),
        ("5 mL", True),
        (" from ", False),
        ("Water", True),
        (" to ", False),
        ("Reactor 1", True),
    ]


def test_optional_parameters_join_the_sentence_only_when_set() -> None:
    params = {"source": "w", "target": "r", "volume": "5 mL", "pump": "p", "confirm_with": "b"}
    assert sentence_text("transfer", params, NAMES) == (
        "Transfer 5 mL from Water to Reactor 1 with Pump 2, confirmed by Balance"
    )


def test_a_step_says_that_it_may_stay_unconfirmed_only_where_that_is_ticked() -> None:
    params = {"source": "w", "target": "r", "volume": "5 mL", "confirm_with": "b"}
    plain = "Transfer 5 mL from Water to Reactor 1, confirmed by Balance"
    for is_on, text in [(True, f"{plain}, which may stay unconfirmed"), (False, plain)]:
        told = sentence_text("transfer", {**params, "may_stay_unconfirmed": is_on}, NAMES)
        assert told == text


def test_an_unfinished_step_shows_what_is_missing() -> None:
    assert sentence_text("transfer", {"source": "x"}, NAMES) == "Transfer … from … to …"


@pytest.mark.parametrize("kind", STEP_KINDS)
def test_each_schema_is_json_schema_and_each_quantity_has_a_known_unit(kind: str) -> None:
    schema = STEP_KINDS[kind].schema()
    Draft202012Validator.check_schema(schema)
    orders = [field["x-order"] for field in schema["properties"].values()]
    assert orders == sorted(set(orders))
    for name, field in schema["properties"].items():
        assert field["x-label"]
        assert field["x-help"]
        assert not (field["x-advanced"] and name in schema["required"])
        if "x-quantity" in field:
            assert field["x-unit"] in DIMENSIONS[field["x-quantity"]].units


@pytest.mark.parametrize("kind", STEP_KINDS)
def test_each_step_starts_and_is_done(kind: str) -> None:
    operation = STEP_KINDS[kind]
    assert operation.inputs[0].name == "start"
    assert operation.outputs[0].name == "done"
    assert operation.inputs[0].kind is operation.outputs[0].kind is PortKind.DONE


def test_measuring_steps_give_a_value() -> None:
    giving = {
        kind
        for kind, operation in STEP_KINDS.items()
        if any(port.kind is PortKind.DATA for port in operation.outputs)
    }
    assert giving == {"weigh", "measure_ph"}


def test_the_palette_is_plain_json() -> None:
    assert json.loads(json.dumps(palette())) == palette()
    assert [entry["kind"] for entry in palette()] == list(STEP_KINDS)


@pytest.mark.parametrize("kind", [kind for kind, one in STEP_KINDS.items() if one.matter])
def test_what_a_step_does_to_matter_names_parameters_of_it(kind: str) -> None:
    operation = STEP_KINDS[kind]
    matter = operation.matter
    assert matter is not None
    assert bool(matter.moves or matter.unproved)
    assert bool(matter.moves) == bool(matter.source) == bool(matter.target)
    named = {matter.source, matter.target, matter.stated} - {""}
    assert all(operation.parameter(name) is not None for name in named)


def test_a_step_that_may_name_a_pump_says_what_it_does_to_matter() -> None:
    pumping = [one for one in STEP_KINDS.values() if one.parameter("pump") is not None]
    assert {one.kind for one in pumping} >= {"transfer", "separate", "filter", "push_gas"}
    assert all(one.matter is not None for one in pumping)
