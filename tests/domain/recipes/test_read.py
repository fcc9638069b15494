"""A recipe is read whole, or everything wrong with it is listed, with line and column."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.errors import ProtocolError, UnitError
from labweb.domain.recipes.xdl.file_format.attribute_values import XdlQuantity, read_value
from labweb.domain.recipes.xdl.file_format.read_xdl import check_available, check_document, read_xdl
from labweb.domain.recipes.xdl.file_format.xml_tree import parse_markup
from labweb.domain.recipes.xdl.tables import step_table as table
from labweb.domain.recipes.xdl.tables.step_spec import STEPS
from tests.domain.recipes.asking import codes, recipe, refused, text

ADD = '<Add vessel="reactor" reagent="water" volume="5 mL"/>'


def test_a_step_is_read_with_its_values() -> None:
    (step,) = recipe(
        '<Add vessel="reactor" reagent="water" volume="5 mL" stir="True"/>'
    ).synthesis.steps
    assert step.name == "Add"
    assert step.values["vessel"] == "reactor"
    assert step.values["stir"] is True
    assert isinstance(step.values["volume"], XdlQuantity)
    assert step.values["volume"].exact == 5


def test_everything_wrong_is_listed_at_once_with_its_place() -> None:
    raw = text(
        '\n<Add vesel="reactor" reagent="sugar" volume="5 g"/>'
        '\n<Mix vessel="reactor"/>\n<Stir vessel="beaker" time="ten minutes"/>'
    )
    found = [(f.code, f.context["line"], f.context["column"]) for f in refused(raw)]
    assert found == [
        ("xdl.missing_property", 2, 1),
        ("xdl.unknown_property", 2, 6),
        ("xdl.reagent_not_declared", 2, 22),
        ("unit.unknown", 2, 38),
        ("xdl.unknown_step", 3, 1),
        ("xdl.vessel_not_declared", 4, 7),
        ("unit.unreadable", 4, 23),
    ]
    assert "did you mean 'vessel'?" in refused(raw)[1].message


@pytest.mark.parametrize(
    ("steps", "code"),
    [
        ('<Add vessel="reactor" reagent="water"/>', "xdl.missing_property"),
        ('<Add vessel="reactor" reagent="water" volume="1 mL" amount="1 g"/>', "xdl.two_amounts"),
        ('<Add vessel="reactor" reagent="water" amount="5"/>', "unit.missing"),
        ('<Add vessel="reactor" reagent="water" volume="1,5 mL"/>', "unit.comma"),
        ('<Add vessel="reactor" reagent="water" volume="two drops"/>', "unit.vague"),
        ('<Add vessel="" reagent="water" volume="1 mL"/>', "xdl.empty_value"),
        ('<Add vessel="reactor" reagent="water" volume="1 mL" stir="maybe"/>', "xdl.bad_value"),
        (
            '<Add vessel="reactor" reagent="water" volume="1 mL" purpose="fun"/>',
            "xdl.unknown_choice",
        ),
        ('<HeatChill vessel="reactor" temp="-300 °C" time="1 h"/>', "unit.out_of_range"),
        ('<StartStir vessel="reactor"><Wait time="1 s"/></StartStir>', "xdl.unexpected_children"),
        ('<Async pid="a"/>', "xdl.no_children"),
        ('<Await pid="a"/>', "xdl.unknown_pid"),
        ('<Repeat repeats="1.5"><Wait time="1 s"/></Repeat>', "xdl.bad_value"),
        ('<Repeat><Wait time="1 s"/></Repeat>', "xdl.repeat_end"),
        ('<Repeat repeats="2" x.role="solvent"><Wait time="1 s"/></Repeat>', "xdl.repeat_end"),
        ('<Repeat x.colour="red"><Wait time="1 s"/></Repeat>', "xdl.unknown_property"),
        ('<Repeat x.role="a" x.type="b"><Wait time="1 s"/></Repeat>', "xdl.loop_kind"),
        ('<Repeat water.role="a"><Wait time="1 s"/></Repeat>', "xdl.duplicate_id"),
        ('<Wait time="1 s" param.time="t"/>', "xdl.property_twice"),
        ('<Wait param.time="t"/>', "xdl.no_parameter_value"),
        ('<Prep colour="red"/>', "xdl.unknown_property"),
        ('<Monitor target="reactor" quantity="pH"/>', "xdl.missing_property"),
    ],
)
def test_what_xdl_does_not_say_is_refused(steps: str, code: str) -> None:
    assert code in codes(text(steps))


@pytest.mark.parametrize(
    ("raw", "code"),
    [
        (b"<Recipe/>", "xdl.root"),
        (b"<XDL/>", "xdl.missing_section"),
        (b'<XDL a="b"><Synthesis/></XDL>', "xdl.unknown_property"),
        (b"<XDL><Other/></XDL>", "xdl.unknown_section"),
        (b'<?xdl version="3.0"?><XDL/>', "xdl.unknown_version"),
        (text(ADD, extra="<Reagents/>"), "xdl.section_twice"),
        (text(ADD, extra="<Variables/>"), "xdl.unknown_section"),
        (
            text(ADD, extra='<Parameters><Parameter id="p" type="colour"/></Parameters>'),
            "xdl.unknown_choice",
        ),
        (
            text(ADD, extra='<Parameters><Parameter id="p" type="time" value="5 g"/></Parameters>'),
            "unit.unknown",
        ),
        (
            text(ADD, extra='<Parameters><Parameter id="water" type="time"/></Parameters>'),
            "xdl.duplicate_id",
        ),
        (text(ADD, extra='<Metadata colour="red"/>'), "xdl.unknown_property"),
        (text(ADD, reagents="<Reagent/>"), "xdl.missing_property"),
        (text(ADD, reagents='<Reagent name="water" density="1.5 g/cm2"/>'), "unit.unknown"),
        (text(ADD, reagents='<Reagent name="water" molecular_formula="c4-H10"/>'), "xdl.bad_value"),
        (
            text(ADD, reagents='<Reagent name="water" clean_with="soap"/>'),
            "xdl.reagent_not_declared",
        ),
        (text(ADD, reagents='<Chemical name="water"/>'), "xdl.unknown_section"),
        (text(ADD, before="<Blueprint/>"), "xdl.missing_property"),
        (text(ADD, before='<Blueprint id="Add"><Procedure/></Blueprint>'), "xdl.duplicate_id"),
        (text(ADD, before='<Blueprint id="B"/>'), "xdl.missing_section"),
        (
            text(ADD, before='<Blueprint id="B"><Procedure base_scale="5 mL"/></Blueprint>'),
            "xdl.bad_value",
        ),
    ],
)
def test_a_file_that_is_built_wrong_is_refused(raw: bytes, code: str) -> None:
    assert code in codes(raw)


def test_a_blueprint_that_uses_itself_is_refused() -> None:
    before = (
        "<Blueprint id='A'><Procedure><B/></Procedure></Blueprint>"
        "<Blueprint id='B'><Procedure><A/></Procedure></Blueprint>"
    )
    assert codes(text("<A/>", before=before)) == ["xdl.blueprint_circle"] * 2


def test_names_of_a_use_count_inside_of_a_blueprint() -> None:
    before = (
        "<Blueprint id='B'><Hardware><Component id='v' type='reactor'/></Hardware><Reagents>"
        "<Reagent id='r'/></Reagents><Procedure><Add vessel='v' reagent='water' volume='1 mL'/>"
        "</Procedure></Blueprint>"
    )
    recipe("<B v='reactor' r='water'/>", before=before)
    assert codes(text("<B v='reactor' r='salt'/>", before=before)) == ["xdl.reagent_not_declared"]
    assert codes(text("<B v='reactor' r='water' q='1'/>", before=before)) == ["xdl.unknown_mapping"]
    assert codes(text("<B r='water'/>", before=before)) == ["xdl.vessel_not_declared"]
    assert codes(text("<B v='reactor'/>", before=before)) == ["xdl.reagent_not_declared"] * 2


def test_blueprints_may_lie_in_another_file() -> None:
    library = parse_markup(
        b"<XDL><Blueprint id='B'><Procedure><Wait time='1 s'/></Procedure></Blueprint></XDL>"
    )
    assert read_xdl(text("<B/>"), library=[library]).blueprints["B"].steps
    with pytest.raises(ProtocolError) as caught:
        read_xdl(text("<B/>"), library=[library, library])
    assert caught.value.code == "xdl.duplicate_id"


def test_vessels_of_the_rig_count_when_it_is_known() -> None:
    raw = text('<StartStir vessel="rotavap"/>')
    assert codes(raw) == ["xdl.vessel_not_declared"]
    assert read_xdl(raw, rig_vessels=frozenset({"rotavap"})).synthesis.steps


def test_what_the_laboratory_lacks_is_listed() -> None:
    missing = check_available(recipe(ADD), frozenset({"reactor"}))
    assert [(f.code, f.context["line"]) for f in missing] == [("xdl.vessel_not_available", 1)]


@pytest.mark.parametrize("old", ["0.1.10", "0.2.0", "0.3.1", "0.4.0", "0.5.0", "1.0.0", "2.0.0"])
def test_every_version_is_read(old: str) -> None:
    raw = f'<?xdl version="{old}" ?>'.encode() + text(ADD)
    assert read_xdl(raw).version == old


def test_names_before_the_renaming_mean_what_they_are_called_now() -> None:
    (step,) = recipe(
        '<Separate purpose="wash" product_bottom="True" n_separations="2" from_vessel="reactor"'
        ' separation_vessel="flask" to_vessel="reactor" solvent=""/>'
    ).synthesis.steps
    assert (step.values["product_phase"], step.values["repeats"]) == ("bottom", 2)
    assert "solvent" not in step.values


def test_every_property_of_every_step_is_of_a_sort_that_is_read() -> None:
    for spec in STEPS.steps.values():
        for wanted in spec.properties.values():
            with pytest.raises(UnitError):
                read_value("\x01" if wanted.choices else "", wanted)


def test_each_property_beside_the_standard_says_what_it_means() -> None:
    for name in table.FURTHER:
        assert STEPS.steps[name].means
    for step, line in table.EXTENSIONS.items():
        for entry in line.split():
            assert STEPS.steps[step].properties[entry.split(":")[0]].means


SIGNS = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc", "Cn")), max_size=20)


@given(SIGNS, SIGNS)
def test_any_text_in_an_attribute_is_read_or_refused(volume: str, vessel: str) -> None:
    step = f"<Add vessel={quoteattr(vessel)} reagent='water' volume={quoteattr(volume)}/>"
    _, findings = check_document(parse_markup(text(step)))
    assert all(f.code.split(".")[0] in {"xdl", "unit"} for f in findings)
    if not findings:
        read_xdl(text(step))
