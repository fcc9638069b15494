"""The graph as a PROV document, read back by the `prov` package and by our own reader."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from prov.model import ProvDocument

from labweb.domain.crutd.provenance.graph_from_record import build_graph
from labweb.domain.crutd.provenance.prov_check import check_prov
from labweb.domain.crutd.provenance.prov_json_read import ProvStatement, read_prov
from labweb.domain.crutd.provenance.prov_json_write import VOCABULARY, render_prov
from labweb.domain.crutd.provenance.provenance_graph import (
    ENDS,
    Bond,
    ProvGraph,
    ProvKind,
    ProvNode,
    Relation,
    make_graph,
)
from labweb.domain.crutd.provenance.qualified_names import escape, unescape
from labweb.domain.errors import DefinitionError, Finding
from tests.domain.crutd.provenance.records import LAB, RECORD, at

HOME = f"urn:uuid:{LAB}#"
TEXTS = st.text(
    st.characters(blacklist_categories=["Cs"], blacklist_characters="\x00"), min_size=1, max_size=12
)
FACTS = st.dictionaries(
    TEXTS,
    st.one_of(
        TEXTS,
        st.booleans(),
        st.integers(-(2**70), 2**70),
        st.floats(allow_nan=False),
    ),
    max_size=3,
)


@st.composite
def graphs(draw: st.DrawFn) -> ProvGraph:
    nodes = [
        ProvNode(
            id=f"{kind.value}/{name}",
            kind=kind,
            type=draw(TEXTS),
            name=draw(TEXTS),
            started_at=at(draw(st.integers(0, 59))) if draw(st.booleans()) else "",
            facts=draw(FACTS),
        )
        for kind in ProvKind
        for name in draw(st.lists(TEXTS, min_size=1, max_size=3, unique=True))
    ]
    of = {kind: [node.id for node in nodes if node.kind is kind] for kind in ProvKind}
    relations = []
    for bond in draw(st.lists(st.sampled_from(Bond), max_size=8)):
        later, earlier = ENDS[bond]
        if later is None or earlier is None:
            continue
        relations.append(
            Relation(
                bond=bond,
                later=draw(st.sampled_from(of[later])),
                earlier=draw(st.sampled_from(of[earlier])),
                role=draw(st.sampled_from(["", "source", "a role: ü"])),
                facts={} if bond is Bond.MEMBER else draw(FACTS),
            )
        )
    return make_graph(nodes[0].id, nodes, relations)


def read_by_prov(document: dict[str, Any]) -> ProvDocument:
    return ProvDocument.deserialize(content=json.dumps(document), format="json")


def plain(statements: tuple[ProvStatement, ...]) -> list[Any]:
    return sorted(
        (s.kind, str(s.id), sorted(s.arguments.items()), sorted(map(str, set(s.attributes))))
        for s in statements
    )


def assert_comes_back_equal(document: dict[str, Any]) -> None:
    first = read_by_prov(document)
    text = first.serialize(format="json")
    assert text is not None
    again = ProvDocument.deserialize(content=text, format="json")
    assert first == again
    ours, theirs = read_prov(json.dumps(document).encode()), read_prov(text.encode())
    assert plain(ours.statements) == plain(theirs.statements)
    assert len(ours.statements) == len(list(first.get_records()))


def test_a_run_comes_back_equal_from_prov_and_contradicts_itself_nowhere() -> None:
    document = render_prov(build_graph(RECORD), LAB)
    assert_comes_back_equal(document)
    assert check_prov(read_prov(json.dumps(document).encode())) == []


@settings(max_examples=40, deadline=None)
@given(graphs())
def test_any_graph_comes_back_equal_from_prov(graph: ProvGraph) -> None:
    assert_comes_back_equal(render_prov(graph, LAB))


@given(st.text(st.characters(blacklist_categories=["Cs"]), max_size=20))
def test_an_escaped_name_is_read_back_and_no_two_texts_share_one(text: str) -> None:
    assert unescape(escape(text)) == text
    assert escape(text).isascii()


def test_people_software_plans_and_racks_carry_the_types_of_prov() -> None:
    found = read_prov(json.dumps(render_prov(build_graph(RECORD), LAB)).encode())
    types = {
        s.id: {v.text for name, v in s.attributes if name.endswith("prov#type")}
        for s in found.statements
        if s.id
    }
    prov = "http://www.w3.org/ns/prov#"
    assert types[f"{HOME}user/u1"] == {f"{VOCABULARY}user", f"{prov}Person"}
    assert types[f"{HOME}host/h1"] == {f"{VOCABULARY}host", f"{prov}SoftwareAgent"}
    assert types[f"{HOME}plan/r1"] == {f"{VOCABULARY}plan", f"{prov}Plan"}
    assert types[f"{HOME}resource/n-rack"] == {f"{VOCABULARY}resource", f"{prov}Collection"}


def test_times_places_and_numbers_are_typed() -> None:
    document = render_prov(build_graph(RECORD), LAB)
    assert document["activity"]["lab:transaction/t2"]["prov:startTime"] == at(2)
    state = document["entity"]["lab:state/v-reactor/6"]
    assert state["prov:location"] == {"$": "lab:resource/n-bench", "type": "prov:QUALIFIED_NAME"}
    heated = document["entity"]["lab:state/n-heater/4"]
    assert heated["labweb:temp%20c"] == {"$": "60.5", "type": "xsd:double"}
    amounts = [r["labweb:amount_nl"] for r in document["used"].values() if "labweb:amount_nl" in r]
    assert amounts == [{"$": "5000", "type": "xsd:long"}] * 2


def test_the_same_graph_gives_the_same_text() -> None:
    one, other = (json.dumps(render_prov(build_graph(RECORD), LAB)) for _ in range(2))
    assert one == other


def refusal(document: object) -> list[tuple[str, str]]:
    raw = document if isinstance(document, bytes) else json.dumps(document).encode()
    with pytest.raises(DefinitionError) as caught:
        read_prov(raw)
    return [(finding.subject, finding.code) for finding in caught.value.findings]


EX = {"prefix": {"ex": "http://example.org/"}}


@pytest.mark.parametrize(
    ("document", "where", "code"),
    [
        (b"{", "", "prov.not_json"),
        (b"\xff", "", "prov.not_json"),
        (b'{"entity": NaN}', "", "prov.not_json"),
        (b"[" * 100_000, "", "prov.not_json"),
        ([1], "", "prov.shape"),
        ({"prefix": {"ex": 3}}, "prefix/ex", "prov.shape"),
        ({"prefix": {"prov": "http://x/"}}, "prefix/prov", "prov.undeclared_prefix"),
        ({"thing": {}}, "thing", "prov.unknown_record"),
        ({"entity": {"ex:a": {}}}, "entity/ex:a", "prov.undeclared_prefix"),
        ({"entity": {"a": {}}}, "entity/a", "prov.undeclared_prefix"),
        ({**EX, "entity": {"ex:a": [{}, 3]}}, "entity/ex:a/1", "prov.shape"),
        ({**EX, "used": {"ex:u": {"prov:entity": 3}}}, "used/ex:u/prov:entity", "prov.shape"),
        (
            {**EX, "activity": {"ex:a": {"prov:startTime": "yesterday"}}},
            "activity/ex:a/prov:startTime",
            "prov.value",
        ),
        (
            {**EX, "activity": {"ex:a": {"prov:startTime": "2026-13-01T00:00:00Z"}}},
            "activity/ex:a/prov:startTime",
            "prov.value",
        ),
        (
            {**EX, "entity": {"ex:a": {"ex:n": ["1", {"$": "2x", "type": "xsd:int"}]}}},
            "entity/ex:a/ex:n/1",
            "prov.value",
        ),
        (
            {**EX, "entity": {"ex:a": {"ex:n": {"$": "300", "type": "xsd:byte"}}}},
            "entity/ex:a/ex:n",
            "prov.value",
        ),
        (
            {**EX, "entity": {"ex:a": {"ex:n": {"$": "no:x", "type": "prov:QUALIFIED_NAME"}}}},
            "entity/ex:a/ex:n",
            "prov.value",
        ),
        (
            {**EX, "entity": {"ex:a": {"ex:n": {"$": "x", "lang": "not a tag"}}}},
            "entity/ex:a/ex:n",
            "prov.value",
        ),
        (
            {**EX, "bundle": {"ex:b": {"entity": {"no:a": {}}}}},
            "bundle/ex:b/entity/no:a",
            "prov.undeclared_prefix",
        ),
        ({**EX, "bundle": {"ex:b": {"bundle": {}}}}, "bundle/ex:b/bundle", "prov.unknown_record"),
        (
            b'{"prefix": {"ex": "http://e/"}, "entity": {"ex:a": {}, "ex:a": {}}}',
            "entity/ex:a",
            "prov.duplicate_key",
        ),
    ],
)
def test_a_malformed_document_is_refused_at_its_place(
    document: object, where: str, code: str
) -> None:
    assert refusal(document) == [(where, code)]


def test_every_place_is_told_at_once() -> None:
    assert refusal({**EX, "thing": {}, "entity": {"ex:a": None, "no:b": {}}}) == [
        ("thing", "prov.unknown_record"),
        ("entity/ex:a", "prov.shape"),
        ("entity/no:b", "prov.undeclared_prefix"),
    ]


def contradictions(document: dict[str, Any]) -> list[Finding]:
    return check_prov(read_prov(json.dumps({**EX, **document}).encode()))


def test_a_chain_of_special_cases_that_comes_back_is_told_and_a_long_one_is_not() -> None:
    def chain(names: list[str]) -> dict[str, Any]:
        pairs = pairwise(names)
        return {
            "specializationOf": {
                f"_:s{n}": {"prov:specificEntity": f"ex:{a}", "prov:generalEntity": f"ex:{b}"}
                for n, (a, b) in enumerate(pairs)
            }
        }

    assert [f.code for f in contradictions(chain(["a", "b", "c", "a"]))] == ["prov.conflict"]
    assert contradictions(chain([f"n{n}" for n in range(5000)])) == []


def test_a_usage_without_an_activity_of_a_derivation_is_told() -> None:
    derived = {"prov:generatedEntity": "ex:a", "prov:usedEntity": "ex:b", "prov:usage": "ex:u"}
    found = contradictions({"wasDerivedFrom": {"ex:d": derived}})
    assert [(f.code, f.subject) for f in found] == [("prov.conflict", "wasDerivedFrom/ex:d")]


def test_the_same_time_in_two_zones_is_no_contradiction() -> None:
    told = [
        {"prov:startTime": "2012-11-16T16:05:00Z"},
        {"prov:startTime": "2012-11-16T18:05:00.000+02:00"},
    ]
    assert contradictions({"activity": {"ex:a": told}}) == []
    told[1]["prov:startTime"] = "2012-11-16T18:05:01+02:00"
    assert [f.subject for f in contradictions({"activity": {"ex:a": told}})] == ["activity/ex:a/1"]
