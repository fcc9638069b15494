"""Any recipe that can be said is read, written and read again as the same recipe."""

from __future__ import annotations

import json
from itertools import permutations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.errors import ProtocolError
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document, read_xdl
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe
from labweb.domain.recipes.xdl.file_format.write_xdl import VERSIONS, render_as, render_xdl
from labweb.domain.recipes.xdl.file_format.xdl_json import parse_json, render_json
from labweb.domain.recipes.xdl.file_format.xml_tree import (
    Attribute,
    Comment,
    XmlDocument,
    XmlElement,
    render_markup,
)
from labweb.domain.recipes.xdl.tables.notation_table import AMOUNTS, NOTATIONS
from labweb.domain.recipes.xdl.tables.step_spec import STEPS, Property

VESSELS = ["reactor", "flask 2", "filter"]
REAGENTS = ["water", "2 N hydrochloric acid", "CH₂Cl₂ <dry> & cold"]
WORDS = [
    "a",
    "top",
    "é · 漢",
    "<&\"'>",
    "two\nlines\tand a tab",
    "  blanks  ",
    "]]>",
    "--",
    "\u2009",
]
TRUTH = ["True", "False", "true", "false"]
AMOUNT_TEXTS = [f"1.5 {unit}" for notation in AMOUNTS.values() for unit in notation.units]
TEXTS = {
    "vessel": VESSELS,
    "reagent": REAGENTS,
    "bool": TRUTH,
    "stirring": [*TRUTH, "solvent"],
    "count": ["1", "2", "99"],
    "number": ["0", "-1.5", ".5", "12"],
    "amount": AMOUNT_TEXTS,
    "amount_or_all": [*AMOUNT_TEXTS, "all"],
    "masses": ["1g"],
    "reagents": ["water"],
}
"""Valid texts of each sort of property that is not one quantity."""


def texts_of(wanted: Property) -> list[str]:
    """List valid texts of a property, in every unit there is."""
    if wanted.choices:
        return list(wanted.choices)
    if wanted.sort not in NOTATIONS:
        return TEXTS.get(wanted.sort, [word for word in WORDS if word.strip()])
    notation = NOTATIONS[wanted.sort]
    bare = ["2"] if notation.has_bare_numbers else []
    return [
        *bare,
        *notation.words,
        *(f"0.000001 {unit}" for unit in notation.units),
        "1e-3 " + next(iter(notation.units), ""),
    ]


NAMES = [name for name, spec in STEPS.steps.items() if not spec.has_children and name != "Await"]


@st.composite
def steps(draw: st.DrawFn) -> XmlElement:
    spec = STEPS.steps[draw(st.sampled_from(NAMES))]
    names = {p.name for p in spec.properties.values() if p.is_required}
    names |= {draw(st.sampled_from(group)) for group in spec.one_of}
    others = sorted(set(spec.properties) - names)
    names |= set(draw(st.lists(st.sampled_from(others), max_size=4)) if others else ())
    for group in spec.at_most_one:
        names -= set([name for name in group if name in names][1:])
    return XmlElement(
        spec.name,
        tuple(
            Attribute(name, draw(st.sampled_from(texts_of(spec.properties[name]))))
            for name in sorted(names)
        ),
    )


@st.composite
def procedures(draw: st.DrawFn) -> list[XmlElement | Comment]:
    written: list[XmlElement | Comment] = []
    for step in draw(st.lists(steps(), max_size=6)):
        written.append(step)
        match draw(st.integers(0, 5)):
            case 0:
                written.append(Comment(f" {draw(st.sampled_from(WORDS)).replace('-', ' ')} "))
            case 1 if step.tag != "Monitor":
                loop = XmlElement("Repeat", (Attribute("repeats", "2"),), (Comment("in"), step))
                written.append(loop)
    return written


def _document(written: list[XmlElement | Comment]) -> XmlDocument:
    hardware = tuple(
        XmlElement("Component", (Attribute("id", name), Attribute("type", "reactor")))
        for name in VESSELS
    )
    reagents = tuple(XmlElement("Reagent", (Attribute("name", name),)) for name in REAGENTS)
    sections = (
        XmlElement("Hardware", (), hardware),
        XmlElement("Reagents", (), reagents),
        XmlElement("Procedure", (), tuple(written)),
    )
    return XmlDocument(XmlElement("XDL", (), (XmlElement("Synthesis", (), sections),)))


@settings(max_examples=60, deadline=None)
@given(procedures())
def test_a_recipe_of_any_steps_survives_every_form(written: list[XmlElement | Comment]) -> None:
    document = _document(written)
    recipe = read_xdl(render_markup(document).encode())
    assert recipe.document == document
    assert read_xdl(render_xdl(recipe).encode()) == recipe
    again, findings = check_document(parse_json(render_json(recipe.document).encode()))
    assert not findings
    assert again.synthesis.steps == recipe.synthesis.steps
    assert json.loads(render_json(again.document)) == json.loads(render_json(recipe.document))
    for version in VERSIONS:
        text = _written(recipe, version)
        assert text is None or read_xdl(text.encode()).synthesis.steps == recipe.synthesis.steps


def _written(recipe: Recipe, version: str) -> str | None:
    try:
        return render_as(recipe, version)
    except ProtocolError as error:
        if {finding.code for finding in error.findings} != {"xdl.not_in_version"}:
            raise
        return None


HEAD = '<Hardware><Component id="flask" type="flask"/></Hardware>'
REAGENT = '<Reagent name="brine" id="brine" role="reagent"/>'
STEPS_TEXT = '<Procedure><Add vessel="flask" reagent="brine" volume="5 mL"/></Procedure>'


@pytest.mark.parametrize("older", ["0.3", "0.4", "0.5", "1.0"])
def test_a_reagent_whose_id_is_its_name_has_both_again(older: str) -> None:
    text = (
        f'<?xdl version="2.0.0"?><XDL><Synthesis>{HEAD}<Reagents>{REAGENT}</Reagents>'
        f"{STEPS_TEXT}</Synthesis></XDL>"
    )
    recipe = read_xdl(text.encode())
    older_text = render_as(recipe, older)
    assert render_as(read_xdl(older_text.encode()), "2.0") == render_xdl(recipe)


@pytest.mark.parametrize("order", list(permutations(("Hardware", "Parameters", "Reagents"))))
def test_sections_keep_their_order_by_way_of_json(order: tuple[str, ...]) -> None:
    sections = {
        "Hardware": HEAD,
        "Reagents": f"<Reagents>{REAGENT}</Reagents>",
        "Parameters": '<Parameters><Parameter id="v" type="volume" value="5 mL"/></Parameters>',
    }
    inner = "".join(sections[name] for name in order)
    text = (
        f'<?xdl version="2.0.0"?><XDL><Synthesis><Metadata product="x"/>{inner}{STEPS_TEXT}'
        "</Synthesis></XDL>"
    )
    recipe = read_xdl(text.encode())
    as_json = render_as(recipe, "2.0", as_json=True)
    read, findings = check_document(parse_json(as_json.encode()))
    assert not findings
    assert render_xdl(read) == render_xdl(recipe)
