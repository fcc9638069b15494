"""Every published recipe is read, or refused for a reason that is true of it."""

from __future__ import annotations

import json
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from labweb.domain.errors import ProtocolError
from labweb.domain.recipes.xdl.file_format.read_xdl import check_available, check_document, read_xdl
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe
from labweb.domain.recipes.xdl.file_format.write_xdl import (
    VERSIONS,
    check_graph,
    render_as,
    render_xdl,
)
from labweb.domain.recipes.xdl.file_format.xdl_json import parse_json, render_json
from labweb.domain.recipes.xdl.file_format.xml_tree import parse_markup
from tests.corpus import NO_XDL, XDL
from tests.domain.recipes.asking import TEST_TABLE, codes, corpus_files, refused

pytestmark = pytest.mark.skipif(not XDL.exists(), reason=NO_XDL)

DOCS = Path(__file__).parents[3] / "docs/xdl.md"

VERIFIED = {
    "test02.xml": ["xdl.markup"],
    "test03.xml": ["xdl.unknown_step"],
    "test04.xml": ["xdl.missing_property", "xdl.unknown_property"],
    "test05.xml": ["xdl.vessel_not_declared"],
    "test06.xml": ["xdl.reagent_not_declared"],
    "test07.xml": ["xdl.missing_property", "xdl.unknown_property", "xdl.reagent_not_declared"],
    "test09.xml": ["xdl.missing_property", "xdl.missing_property"],
}
"""Why each is refused; its authors count a misspelt property and the property it should be once."""

SYNTAX_2019 = {
    "all_reagents_declared_neg1.xdl": "xdl.reagent_not_declared",
    "all_reagents_declared_neg2.xdl": "xdl.reagent_not_declared",
    "all_reagents_declared_neg4.xdl": "xdl.reagent_not_declared",
    "all_vessels_declared_neg1.xdl": "xdl.vessel_not_declared",
    "all_vessels_declared_neg2.xdl": "xdl.vessel_not_declared",
    "check_quantities_neg1.xdl": "unit.unknown",
    "check_quantities_neg2.xdl": "xdl.vessel_not_declared",
    "components_in_namespace_neg1.xdl": "xdl.unknown_component",
    "has_three_tags_neg1.xdl": "xdl.missing_section",
    "has_three_tags_neg2.xdl": "xdl.missing_section",
    "steps_in_namespace_neg1.xdl": "xdl.unknown_step",
}
"""Why each recipe that must be refused is refused."""


def rig_of(path: Path) -> frozenset[str]:
    """Return the ids of the rig a recipe was published with; none when there is no rig."""
    names = (f"{path.stem}_graph.json", f"{path.stem}.json", "bigrig.json")
    found = next((f for n in names if (f := path.with_name(n)).exists()), path)
    if path.parent.name not in {"unit_0.3", "recipes_0.3"} or found == path:
        return frozenset()
    return frozenset(node["id"] for node in json.loads(found.read_text("utf-8"))["nodes"])


def reasons(path: Path, rig: frozenset[str] = frozenset()) -> set[str]:
    try:
        read_xdl(path.read_bytes(), rig_vessels=rig)
    except ProtocolError as error:
        return {finding.code for finding in error.findings}
    return set()


@cache
def rows() -> list[str]:
    """Count, folder by folder: files, read, read with the rig known, refused and why."""
    lines = []
    folders = sorted({path.relative_to(XDL).parts[0] for path in corpus_files()})
    for folder in folders:
        paths = corpus_files(folder)
        alone = [path for path in paths if not reasons(path)]
        with_rig = [p for p in paths if p not in alone and not reasons(p, rig_of(p))]
        why = Counter(
            code
            for path in paths
            if path not in alone and path not in with_rig
            for code in reasons(path, rig_of(path))
        )
        told = ", ".join(f"`{code}` {count}" for code, count in sorted(why.items()))
        counts = (len(paths), len(alone), len(with_rig), len(paths) - len(alone) - len(with_rig))
        lines.append(f"| `{folder}` | {' | '.join(map(str, counts))} | {told} |")
    return lines


def test_the_docs_say_how_many_published_recipes_are_read() -> None:
    page = DOCS.read_text("utf-8")
    missing = [row for row in rows() if row not in page]
    assert not missing, "docs/xdl.md lacks these rows:\n" + "\n".join(missing)


@pytest.mark.parametrize("name", SYNTAX_2019)
def test_a_recipe_of_2019_that_must_be_refused_is_refused(name: str) -> None:
    assert SYNTAX_2019[name] in codes((XDL / "negative/syntax_2019" / name).read_bytes())


def test_every_recipe_of_2019_that_must_be_read_is_read() -> None:
    paths = corpus_files("negative/syntax_2019")
    assert {p.name for p in paths if "_neg" in p.name} == SYNTAX_2019.keys()
    assert all(not reasons(path) for path in paths if path.name not in SYNTAX_2019)


@pytest.mark.parametrize("name", VERIFIED)
def test_a_recipe_that_its_verifier_refuses_is_refused(name: str) -> None:
    found = refused((XDL / "negative/clairify" / name).read_bytes())
    assert [finding.code for finding in found] == VERIFIED[name]
    assert all(finding.context["line"] for finding in found)


def test_hardware_that_is_not_available_is_listed() -> None:
    recipe = read_xdl((XDL / "negative/clairify/test08.xml").read_bytes())
    (missing,) = check_available(recipe, frozenset({"beaker"}))
    assert missing.code == "xdl.vessel_not_available"
    assert not check_available(recipe, frozenset({"beaker", "beaker2"}))


@cache
def readable() -> list[tuple[str, Recipe]]:
    found = []
    for path in corpus_files():
        recipe, findings = _checked(path)
        if recipe is not None and not findings:
            found.append((path.name, recipe))
    return found


def _checked(path: Path) -> tuple[Recipe | None, list[object]]:
    try:
        document = parse_markup(path.read_bytes())
    except ProtocolError as error:
        return None, list(error.findings)
    recipe, findings = check_document(document, table=TEST_TABLE)
    return recipe, list(findings)


def test_every_recipe_that_is_read_is_written_back_without_loss() -> None:
    assert len(readable()) > 150
    for name, recipe in readable():
        again = read_xdl(render_xdl(recipe).encode(), table=TEST_TABLE)
        assert again == recipe, name


@pytest.mark.parametrize("version", VERSIONS)
def test_a_version_says_the_same_or_refuses(version: str) -> None:
    written = 0
    for name, recipe in readable():
        try:
            text = render_as(recipe, version)
        except ProtocolError as error:
            codes_ = {finding.code for finding in error.findings}
            assert codes_ <= {"xdl.not_in_version", "xdl.compiled"}, name
            continue
        written += 1
        again = read_xdl(text.encode(), table=TEST_TABLE)
        assert [s.steps for s in again.syntheses] == [s.steps for s in recipe.syntheses], name
        assert again.blueprints == recipe.blueprints, name
        assert text.count("<!--") == render_xdl(recipe).count("<!--"), name
    assert written >= {"1.0": 120, "2.0": 145}.get(version, 70)


def test_the_json_form_says_the_same() -> None:
    for name, recipe in readable():
        if len(recipe.syntheses) != 1:
            continue
        document = parse_json(render_json(recipe.document).encode())
        again, findings = check_document(document, table=TEST_TABLE)
        assert not findings, name
        assert again.syntheses[0].steps == recipe.synthesis.steps, name
        assert again.synthesis.reagents == recipe.synthesis.reagents, name
        assert again.blueprints == recipe.blueprints, name
        written = json.loads(render_json(recipe.document))
        assert json.loads(render_json(again.document)) == written, name


def test_the_json_of_the_reference_is_read() -> None:
    why = {}
    for path in sorted((XDL / "xdl2_testfiles/xdl_jsons").glob("*.json")):
        recipe, findings = check_document(parse_json(path.read_bytes()))
        assert recipe.synthesis.steps
        why[path.stem] = {finding.code for finding in findings}
    # A filling that is not named, and a distillation into nothing.
    told = {name: found for name, found in why.items() if found}
    assert told == {
        "AlkylFluor": {"xdl.missing_property"},
        "orgsyn_v87p0016": {"xdl.missing_property"},
    }


def test_a_compiled_recipe_is_known_by_its_graph_and_fits_no_other() -> None:
    recipe = read_xdl((XDL / "xdlexe/mcrav/lidocaine.xdlexe").read_bytes())
    own = "6dda9ed19c8410d9dd34deb6bb5a77e8cf84bcb9dfd22d63f0bdff59bc021132"
    assert recipe.is_compiled
    check_graph(recipe, own)
    with pytest.raises(ProtocolError) as caught:
        check_graph(recipe, "0" * 64)
    assert caught.value.code == "xdl.other_graph"
    with pytest.raises(ProtocolError) as caught:
        render_as(recipe, "2.0")
    assert caught.value.code == "xdl.compiled"
    assert own in caught.value.message
