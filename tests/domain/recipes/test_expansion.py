"""What each unit operation is made of, and that nothing is left running or made up."""

from __future__ import annotations

import gzip
import json
from collections import Counter
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import ProtocolError
from labweb.domain.recipes.xdl.expansion.act_reading import default_number
from labweb.domain.recipes.xdl.expansion.basic_operations import (
    BUFFER,
    EFFECTS,
    INERT_GAS,
    KEPT,
    WASTE,
    BasicKind,
    BasicOperation,
    ContentsEffect,
)
from labweb.domain.recipes.xdl.expansion.expand import Expansion, all_operations, expand
from labweb.domain.recipes.xdl.expansion.operations_table import OPERATIONS
from labweb.domain.recipes.xdl.file_format.read_xdl import read_xdl
from labweb.domain.recipes.xdl.tables.defaults_table import DEFAULTS
from labweb.domain.recipes.xdl.tables.step_spec import STEPS
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold
from tests.corpus import NO_XDL, XDL
from tests.domain.recipes.asking import corpus_files, recipe

needs_corpus = pytest.mark.skipif(not XDL.exists(), reason=NO_XDL)
DOCS = Path(__file__).parents[3] / "docs/xdl.md"

STOPS = {
    BasicKind.START_STIR: BasicKind.STOP_STIR,
    BasicKind.SET_TEMPERATURE: BasicKind.STOP_TEMPERATURE,
    BasicKind.START_VACUUM: BasicKind.STOP_VACUUM,
    BasicKind.START_GAS: BasicKind.STOP_GAS,
    BasicKind.START_ROTATION: BasicKind.STOP_ROTATION,
    BasicKind.LOWER_FLASK: BasicKind.RAISE_FLASK,
    BasicKind.START_LIGHT: BasicKind.STOP_LIGHT,
    BasicKind.START_ULTRASOUND: BasicKind.STOP_ULTRASOUND,
}


def done(steps: str) -> list[tuple[str, dict[str, Any]]]:
    """Expand some steps into kinds and fields, the numbers as plain ones."""
    return [(o.kind.value, plain(o)) for o in all_operations(expand(unfold(recipe(steps))))]


def plain(operation: BasicOperation) -> dict[str, Any]:
    return {k: float(v) if isinstance(v, Decimal) else v for k, v in operation.fields.items()}


def refusals(steps: str) -> set[str]:
    with pytest.raises(ProtocolError) as caught:
        expand(unfold(recipe(steps)))
    return {finding.code for finding in caught.value.findings}


def test_every_step_is_an_operation_and_every_operation_a_step() -> None:
    assert OPERATIONS.keys() == STEPS.steps.keys()


def test_the_docs_list_every_operation() -> None:
    page = DOCS.read_text("utf-8")
    missing = [row for name in OPERATIONS if (row := operation_row(name)) not in page]
    assert not missing, "docs/xdl.md lacks these rows:\n" + "\n".join(missing)


def operation_row(name: str) -> str:
    operation = OPERATIONS[name]
    columns = (operation.needs, operation.before, operation.after)
    told = [", ".join(entry.value for entry in column) for column in columns]
    hazards = ", ".join(hazard.value for hazard in operation.hazards)
    return f"| {name} | {' | '.join(told)} | {operation.effect.value} | {hazards} |"


def test_the_docs_list_every_default_with_its_source() -> None:
    page = DOCS.read_text("utf-8")
    rows = [f"| `{key}` | {d.value} | {d.source} |" for key, d in DEFAULTS.items()]
    missing = [row for row in rows if row not in page]
    assert not missing, "docs/xdl.md lacks these rows:\n" + "\n".join(missing)


@pytest.mark.parametrize("key", DEFAULTS)
def test_every_default_is_a_number(key: str) -> None:
    assert default_number(key) > 0


def test_an_operation_touches_contents_as_its_parts_do() -> None:
    touching = {
        "Add": ContentsEffect.ADDS,
        "Transfer": ContentsEffect.MOVES,
        "Separate": ContentsEffect.SPLITS,
    }
    assert {name: OPERATIONS[name].effect for name in touching} == touching
    assert EFFECTS[BasicKind.ADD_LIQUID] is ContentsEffect.ADDS
    assert BasicKind.WAIT not in EFFECTS


def test_heating_holds_the_temperature_for_the_time() -> None:
    found = done('<HeatChill vessel="reactor" temp="0 °C" time="1 h" stir_speed="300 RPM"/>')
    assert found == [
        ("start_stir", {"vessel": "reactor", "speed_rpm": 300}),
        ("set_temperature", {"vessel": "reactor", "temperature_c": 0}),
        ("await_temperature", {"vessel": "reactor", "low_c": -1, "high_c": 1}),
        ("wait", {"seconds": 3600}),
        ("stop_temperature", {"vessel": "reactor"}),
        ("stop_stir", {"vessel": "reactor"}),
    ]


def test_a_range_of_temperature_is_its_own_window() -> None:
    found = dict(done('<HeatChillToTemp vessel="reactor" temp="20–25 °C"/>'))
    assert found["set_temperature"]["temperature_c"] == 22.5
    assert (found["await_temperature"]["low_c"], found["await_temperature"]["high_c"]) == (20, 25)


def test_what_is_assumed_says_so() -> None:
    steps = '<HeatChill vessel="reactor" temp="r.t." time="overnight" stir="False"/>'
    operations = list(all_operations(expand(unfold(recipe(steps)))))
    assumed = {o.kind: o.assumed for o in operations if o.assumed}
    assert assumed[BasicKind.SET_TEMPERATURE] == (
        "temp=room_temperature",
        "tolerance_c=temperature_tolerance",
    )
    assert assumed[BasicKind.WAIT] == ("time=overnight",)
    (waited,) = [o.fields["seconds"] for o in operations if o.kind is BasicKind.WAIT]
    assert waited == 57600


@pytest.mark.parametrize(
    ("steps", "code"),
    [
        ('<Transfer from_vessel="reactor" to_vessel="flask"/>', "xdl.left_open"),
        ('<HeatChill vessel="reactor" temp="reflux" time="1 h"/>', "xdl.word_unresolved"),
        ('<Wait time="12-16 h"/>', "xdl.range_not_exact"),
        ('<Crystallize vessel="reactor"/>', "xdl.left_open"),
        ('<Callback fn="f"/>', "xdl.not_expanded"),
        ('<AddSolidFromDispenser vessel="reactor" turns="3"/>', "xdl.left_open"),
        ('<Distill vessel="reactor" to_vessel="flask" temp="90 °C"/>', "xdl.left_open"),
        ('<Evaporate vessel="reactor" mode="manual" temp="40 °C"/>', "xdl.left_open"),
        ('<CleanVessel vessel="reactor" solvent="water"/>', "xdl.left_open"),
        (
            '<Transfer from_vessel="reactor" to_vessel="flask" volume="all"'
            ' rinsing_solvent="water"/>',
            "xdl.left_open",
        ),
    ],
)
def test_what_no_table_can_fill_in_is_refused(steps: str, code: str) -> None:
    assert refusals(steps) == {code}


def separated(purpose: str, phase: str, repeats: int) -> list[tuple[str, str, str]]:
    steps = (
        f'<Separate purpose="{purpose}" product_phase="{phase}" from_vessel="reactor"'
        f' separation_vessel="flask" to_vessel="reactor" solvent="water" repeats="{repeats}"/>'
    )
    return [
        (
            kind,
            str(fields.get("lower_to") or fields["source"]),
            str(fields.get("upper_to") or fields["target"]),
        )
        for kind, fields in done(steps)
        if kind in {"separate_phases", "transfer"}
    ]


@pytest.mark.parametrize(
    ("purpose", "phase", "moves"),
    [
        (
            "wash",
            "top",
            [("separate_phases", WASTE, "flask"), ("separate_phases", WASTE, "reactor")],
        ),
        (
            "wash",
            "bottom",
            [
                ("separate_phases", BUFFER, WASTE),
                ("transfer", BUFFER, "flask"),
                ("separate_phases", "reactor", WASTE),
            ],
        ),
        (
            "extract",
            "bottom",
            [("separate_phases", "reactor", "flask"), ("separate_phases", "reactor", WASTE)],
        ),
        (
            "extract",
            "top",
            [
                ("separate_phases", BUFFER, "reactor"),
                ("transfer", BUFFER, "flask"),
                ("separate_phases", WASTE, "reactor"),
            ],
        ),
    ],
)
def test_a_product_is_washed_again_and_a_waste_phase_extracted_again(
    purpose: str, phase: str, moves: list[tuple[str, str, str]]
) -> None:
    assert separated(purpose, phase, 2) == [("transfer", "reactor", "flask"), *moves]


def test_a_solid_is_washed_as_often_as_asked() -> None:
    kinds = [
        kind
        for kind, _ in done(
            '<WashSolid vessel="reactor" solvent="water" volume="5 mL" repeats="3"/>'
        )
    ]
    assert (
        kinds.count("add_liquid") == kinds.count("draw_filtrate") == kinds.count("stop_vacuum") == 3
    )


def test_the_last_gas_in_a_refilled_vessel_is_inert() -> None:
    found = done('<EvacuateAndRefill vessel="reactor" repeats="2"/>')
    assert [kind for kind, _ in found].count("start_vacuum") == 2
    gases = [fields.get("gas") for kind, fields in found if kind in {"stop_vacuum", "start_gas"}]
    assert gases == [INERT_GAS] * 4


def test_portions_of_a_solid_add_up_and_are_spread_over_the_time() -> None:
    steps = '<AddSolid vessel="reactor" reagent="salt" mass="3 g" portions="3" time="10 min"/>'
    found = done(steps)
    assert [fields["mass_g"] for kind, fields in found if kind == "add_solid"] == [1, 1, 1]
    assert [fields["seconds"] for kind, fields in found if kind == "wait"] == [300, 300]


def test_stirring_that_nobody_began_is_not_stopped() -> None:
    assert [kind for kind, _ in done('<Add vessel="flask" reagent="water" volume="1 mL"/>')] == [
        "add_liquid"
    ]


def test_a_loop_stays_a_loop() -> None:
    (loop,) = expand(unfold(recipe('<Repeat repeats="3"><Wait time="1 s"/></Repeat>')))
    assert loop.act.repeats == 3
    assert [o.kind for child in loop.children for o in child.operations] == [BasicKind.WAIT]


@cache
def expansions() -> list[tuple[Path, tuple[Expansion, ...]]]:
    found = []
    for path in corpus_files():
        try:
            found.append((path, expand(unfold(read_xdl(path.read_bytes())))))
        except (ProtocolError, ValueError):
            continue
    return found


@needs_corpus
def test_the_published_recipes_that_say_enough_are_expanded() -> None:
    assert len(expansions()) >= 135


@needs_corpus
def test_nothing_is_left_running_at_the_end() -> None:
    for path, expanded in expansions():
        running: set[tuple[BasicKind, object]] = set()
        for operation in all_operations(expanded):
            vessel = operation.fields.get("vessel")
            running.discard((operation.kind, vessel))
            if operation.kind in STOPS:
                running.add((STOPS[operation.kind], vessel))
        assert not running, path


@needs_corpus
def test_only_vessels_of_the_recipe_are_named() -> None:
    for path, expanded in expansions():
        synthesis = read_xdl(path.read_bytes()).synthesis
        known = {c.id for c in synthesis.hardware} | {r.id for r in synthesis.reagents}
        known |= {WASTE, BUFFER, KEPT}
        for operation in all_operations(expanded):
            for name in ("vessel", "source", "target", "lower_to", "upper_to"):
                vessel = operation.fields.get(name)
                assert vessel is None or vessel in known or operation.kind is BasicKind.START_GAS, (
                    path
                )


def reference_moves(run: dict[str, Any], graph: dict[str, Any]) -> Counter[tuple[str, float]]:
    nodes = {node["id"]: node for node in graph["nodes"]}
    moves: Counter[tuple[str, float]] = Counter()
    for move in run["moves"]:
        source, target = nodes.get(move["src"], {}), nodes.get(move["dest"], {})
        if source.get("class") == "ChemputerFlask" and target.get("class") != "ChemputerWaste":
            moves[source.get("chemical", ""), round(move["volume"], 4)] += 1
    return moves


REFERENCE = sorted((XDL / "oracle_native").glob("*.json.gz")) if XDL.exists() else []
NOT_COMPARED = {
    "AlkylFluor": "its graph is GraphML, and vessels of the rig are not declared",
    "antiviral_Arbidol_step2": "the reference does not carry it out",
    "orgsyn_v87p0016": "its Distill says neither vessel nor temperature",
}
SPLIT = {("hexane", 1000.0)}
"""Additions that the reference splits because its vessel is smaller."""


@needs_corpus
@pytest.mark.parametrize("path", REFERENCE, ids=lambda path: path.name.split(".")[0])
def test_every_addition_is_one_that_the_reference_makes(path: Path) -> None:
    name = path.name.split(".")[0]
    if name in NOT_COMPARED:
        pytest.skip(NOT_COMPARED[name])
    run = json.loads(gzip.decompress(path.read_bytes()))
    graph = json.loads((XDL.parent / run["graph"]).read_text("utf-8"))
    rig = frozenset(node["id"] for node in graph["nodes"])
    expanded = expand(unfold(read_xdl((XDL.parent / run["recipe"]).read_bytes(), rig_vessels=rig)))
    ours = Counter(
        (str(o.fields["reagent"]), round(float(str(o.fields["volume_ml"])), 4))
        for o in all_operations(expanded)
        if o.kind is BasicKind.ADD_LIQUID and "volume_ml" in o.fields
    )
    assert ours
    assert set(ours - reference_moves(run, graph)) <= SPLIT
