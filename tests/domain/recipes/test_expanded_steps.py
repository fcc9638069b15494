"""What a step of a recipe says beyond a workflow's own step is said by what it expands to."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.errors import ProtocolError
from labweb.domain.recipes.xdl.as_workflow.recipe_to_workflow import to_workflow
from labweb.domain.recipes.xdl.file_format.read_xdl import read_xdl
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold

_HEAD = """<XDL><Synthesis><Hardware><Component id="reactor" type="reactor"/>
<Component id="separator" type="separator"/><Component id="rotavap" type="rotavap"/></Hardware>
<Reagents><Reagent name="ether"/><Reagent name="water"/></Reagents><Procedure>"""
_TAIL = "</Procedure></Synthesis></XDL>"
STATED = Declared(
    waste="waste",
    buffers=["spare_1", "spare_2"],
    lower_layers=[["ether"], ["ether"], ["ether"]],
    boils_off=[["ether"]],
    receivers={"rotavap": "receiver"},
)


def steps_of(steps: str, declared: Declared | None = STATED) -> list[tuple[str, dict[str, Any]]]:
    acts = unfold(read_xdl((_HEAD + steps + _TAIL).encode()))
    document = to_workflow(acts, name="Expanded", declared=declared)
    return [(step["kind"], step["params"]) for step in document["steps"]]


def notes_of(steps: str) -> list[str]:
    acts = unfold(read_xdl((_HEAD + steps + _TAIL).encode()))
    return [step["note"] for step in to_workflow(acts, name="N", declared=STATED)["steps"]]


def codes(steps: str, declared: Declared | None = STATED) -> set[str]:
    with pytest.raises(ProtocolError) as caught:
        steps_of(steps, declared)
    return {finding.code for finding in caught.value.findings}


WARM = '<HeatChillToTemp vessel="reactor" temp="40 °C" stir="false" {more}/>'
NEAR = 'lower_temp_tolerance="0.5 °C" upper_temp_tolerance="0.5 °C"'
SEPARATE = (
    '<Separate purpose="{purpose}" product_phase="{phase}" from_vessel="reactor" '
    'separation_vessel="separator" to_vessel="rotavap" solvent="ether" '
    'solvent_volume="20 mL" repeats="2"/>'
)


def test_a_tolerance_is_how_near_the_temperature_has_to_come() -> None:
    warm, stop = steps_of(WARM.format(more=NEAR))
    assert warm[1] == {"vessel": "@reactor", "temperature": "40 °C", "tolerance": "0.5 K"}
    assert stop[0] == "stop_heat_stir"


def test_a_temperature_that_comes_by_itself_is_waited_for() -> None:
    found = steps_of(WARM.format(more='active="false"'))
    window = {"vessel": "@reactor", "lowest": "39 °C", "highest": "41 °C"}
    assert ("await_temperature", window) in found


@pytest.mark.parametrize(
    ("before", "window"), [("90 °C", {"highest": "41 °C"}), ("5 °C", {"lowest": "39 °C"})]
)
def test_what_was_hotter_or_colder_passes_one_limit(before: str, window: dict[str, str]) -> None:
    first = WARM.format(more="").replace("40 °C", before)
    found = steps_of(first + WARM.format(more='active="false"'))
    assert ("await_temperature", {"vessel": "@reactor", **window}) in found


def test_what_is_async_goes_on_beside_the_rest_until_it_is_awaited() -> None:
    wait = '<Wait time="{s} s"/>'
    recipe = (
        f'{wait.format(s=1)}<Async pid="a">{wait.format(s=2)}{wait.format(s=3)}</Async>'
        f'<Async pid="b">{wait.format(s=4)}</Async>{wait.format(s=5)}'
        f'<Await pid="a"/>{wait.format(s=6)}'
    )
    acts = unfold(read_xdl((_HEAD + recipe + _TAIL).encode()))
    document = to_workflow(acts, name="Async", declared=STATED)
    lasts = {step["id"]: step["params"]["duration"] for step in document["steps"]}
    after: dict[str, set[str]] = {}
    for edge in document["edges"]:
        after.setdefault(lasts[edge["target"]], set()).add(lasts[edge["source"]])
    assert after == {
        "2 s": {"1 s"},
        "3 s": {"2 s"},
        "4 s": {"1 s"},
        "5 s": {"1 s"},
        "6 s": {"5 s", "3 s"},
    }


def test_a_wider_tolerance_is_met_by_the_usual_one() -> None:
    wide = 'lower_temp_tolerance="5 °C" upper_temp_tolerance="5 °C"'
    assert "tolerance" not in steps_of(WARM.format(more=wide))[0][1]


def test_heating_that_does_not_go_on_ends_at_the_temperature() -> None:
    found = steps_of(WARM.format(more='continue_heatchill="false"'))
    assert [kind for kind, _ in found] == ["heat_chill", "stop_heat"]


def test_a_transfer_is_rinsed_after_it() -> None:
    rinsed = (
        '<Transfer from_vessel="reactor" to_vessel="separator" volume="all" '
        'rinsing_solvent="ether" rinsing_volume="5 mL" rinsing_repeats="2"/>'
    )
    found = [(p["source"], p["target"], p["volume"]) for _, p in steps_of(rinsed)]
    over, rinse = ("@reactor", "@separator", "all"), ("@ether", "@reactor", "5 mL")
    assert found == [over, rinse, over, rinse, over]


def test_stirring_that_goes_on_is_not_stopped_before_the_end() -> None:
    on = '<Stir vessel="reactor" time="5 min" continue_stirring="true"/><Wait time="1 s"/>'
    assert [kind for kind, _ in steps_of(on)] == ["start_stir", "wait", "wait", "stop_stir"]


def test_a_speed_of_pushing_is_the_rate_of_the_step() -> None:
    add = '<Add vessel="reactor" reagent="ether" volume="1 mL" dispense_speed="6 mL/min"/>'
    assert steps_of(add)[0][1]["flow_rate"] == "100.0 uL/s"


def test_what_no_plan_does_is_a_note_at_its_step() -> None:
    flush = (
        '<Transfer from_vessel="reactor" to_vessel="separator" volume="1 mL" flush_tubing="true"/>'
    )
    assert any("flush_tubing of Transfer" in note for note in notes_of(flush))


@pytest.mark.parametrize(
    ("purpose", "phase", "wanted"),
    [
        # The product stays on top while it is washed; what is below goes to the waste.
        ("wash", "top", [("@waste", ""), ("@waste", "@rotavap")]),
        # The product is below: it waits where it goes in the end, and comes back for the second.
        ("wash", "bottom", [("@rotavap", "@waste"), ("@rotavap", "@waste")]),
        # The product is drawn off below in each round; what is extracted stays where it is.
        ("extract", "bottom", [("@rotavap", ""), ("@rotavap", "@waste")]),
        # The product is on top; what is below waits, and comes back to be extracted again.
        ("extract", "top", [("@spare_1", "@rotavap"), ("@waste", "@rotavap")]),
    ],
)
def test_layers_that_are_parted_twice_go_where_each_round_says(
    purpose: str, phase: str, wanted: list[tuple[str, str]]
) -> None:
    found = steps_of(SEPARATE.format(purpose=purpose, phase=phase))
    parted = [place for place, (kind, _) in enumerate(found) if kind == "separate"]
    assert [found[place][1]["target"] for place in parted] == [lower for lower, _ in wanted]
    uppers = [
        params["target"]
        for kind, params in found
        if (kind, params.get("source")) == ("transfer", "@separator")
    ]
    assert uppers == [upper for _, upper in wanted if upper]
    between = [p["source"] for _, p in found[parted[0] : parted[1]] if p.get("source")]
    is_back = (purpose, phase) in {("wash", "bottom"), ("extract", "top")}
    assert (wanted[0][0] in between) is is_back


def test_an_evaporation_that_ends_by_itself_lasts_all_of_its_time_and_says_so() -> None:
    boil = '<Evaporate vessel="rotavap" temp="40 °C" pressure="50 mbar" time="30 min" mode="auto"/>'
    assert steps_of(boil)[0][1]["duration"] == "1800 s"
    assert any("it lasts all of its time" in note for note in notes_of(boil))


def test_ports_of_vessels_are_those_of_the_recipe() -> None:
    one = '<Transfer from_vessel="reactor" to_vessel="separator" volume="1 mL" to_port="top"/>'
    assert steps_of(one)[0][1]["target_port"] == "top"
    ports = ' to_port="evaporate"/>'
    both = SEPARATE.format(purpose="extract", phase="bottom").replace("/>", ports)
    found = [p.get("target_port") for kind, p in steps_of(both) if kind == "separate"]
    assert found == ["evaporate", "evaporate"]


def test_what_nobody_states_of_a_layer_is_left_to_the_run() -> None:
    stated = Declared(waste="w", lower_layers=[["ether"]])
    found = steps_of(SEPARATE.format(purpose="wash", phase="top"), stated)
    assert [params.get("lower") for kind, params in found if kind == "separate"] == [
        {"ether": "all"},
        None,
    ]


@pytest.mark.parametrize(
    ("steps", "declared", "code"),
    [
        (WARM.format(more='lower_temp_tolerance="0 °C"'), STATED, "xdl.not_in_workflow"),
        (
            SEPARATE.format(purpose="extract", phase="top"),
            Declared(waste="w", lower_layers=[["ether"]] * 2),
            "xdl.not_declared",
        ),
        (SEPARATE.format(purpose="wash", phase="top"), None, "xdl.not_declared"),
        (
            '<Add vessel="reactor" reagent="ether" volume="1 mL" aspiration_speed="6 mL/min"/>',
            STATED,
            "xdl.not_in_workflow",
        ),
        (
            '<Add vessel="reactor" reagent="ether" volume="1 mL" viscous="true"/>',
            STATED,
            "xdl.not_in_workflow",
        ),
        ('<StartHeatChill vessel="reactor" temp="40 °C"/>', STATED, "xdl.not_in_workflow"),
        (
            '<Add vessel="reactor" reagent="ether" volume="1 mL" time="10 s" '
            'dispense_speed="1 mL/min"/>',
            STATED,
            "xdl.two_rates",
        ),
    ],
)
def test_what_cannot_be_said_in_full_is_told(
    steps: str, declared: Declared | None, code: str
) -> None:
    assert code in codes(steps, declared)
