"""One graph of matter, acts, people, devices and code."""

from __future__ import annotations

from dataclasses import replace

import pytest

from labweb.domain.crutd.provenance.graph_from_record import build_graph
from labweb.domain.crutd.provenance.graph_views import to_dot, to_json, to_rows
from labweb.domain.crutd.provenance.provenance_graph import (
    Bond,
    ProvKind,
    ProvNode,
    Relation,
    make_graph,
    redacted,
)
from tests.domain.crutd.provenance.records import RECORD, TRANSACTIONS, at

GRAPH = build_graph(RECORD)


def ends(bond: Bond, *, role: str | None = None) -> set[tuple[str, str]]:
    return {
        (r.later, r.earlier)
        for r in GRAPH.relations
        if r.bond is bond and (role is None or r.role == role)
    }


def test_a_transfer_uses_the_source_as_it_was_and_leaves_two_new_states() -> None:
    assert ("transaction/t3", "state/v-syringe/2") in ends(Bond.USED, role="source")
    assert ("state/v-reactor/3", "transaction/t3") in ends(Bond.GENERATED, role="target")
    assert ("state/v-syringe/3", "transaction/t3") in ends(Bond.GENERATED, role="source")
    assert ("state/v-reactor/3", "state/v-syringe/2") in ends(Bond.DERIVED)
    assert ("state/v-reactor/3", "resource/v-reactor") in ends(Bond.SPECIAL_CASE)
    revisions = {(r.later, r.earlier) for r in GRAPH.relations if r.is_revision}
    assert ("state/v-syringe/3", "state/v-syringe/2") in revisions


def test_a_reactors_contents_lead_back_to_the_lot() -> None:
    back = {later: earlier for later, earlier in ends(Bond.DERIVED) if "water" not in later}
    assert back["state/v-syringe/2"] == "state/v-water/1"
    assert ("state/v-water/1", "lot/water") in ends(Bond.DERIVED)
    assert ("transaction/t1", "lot/water") in ends(Bond.USED, role="received")


def test_amounts_stand_on_what_was_used_and_on_what_came_of_it() -> None:
    poured = [r for r in GRAPH.relations if "transaction/t2" in {r.later, r.earlier}]
    told = {(r.bond, r.role): r.facts.get("amount_nl") for r in poured}
    assert told[Bond.USED, "source"] == told[Bond.GENERATED, "target"] == 5000


def test_a_job_is_borne_by_a_device_for_a_host_for_a_person() -> None:
    assert ("transaction/t2", "job/j2") in ends(Bond.INFORMED)
    assert ("job/j2", "run/r1") in ends(Bond.INFORMED)
    assert ("job/j2", "device/d-pump") in ends(Bond.ASSOCIATED)
    assert {("device/d-pump", "host/h1"), ("host/h1", "user/u1")} <= ends(Bond.ON_BEHALF)
    assert ("job/j2", "driver/d-pump-digest") in ends(Bond.USED, role="driver")
    assert GRAPH.nodes["driver/d-pump-digest"].name == "TricontinentC3000"


def test_a_run_has_a_plan_from_a_version_and_was_informed_of_the_decision() -> None:
    assert ("plan/r1", "version/w1") in ends(Bond.DERIVED)
    assert ("version/w1", "user/u1") in ends(Bond.ATTRIBUTED)
    assert ("run/r1", "decision/a1") in ends(Bond.INFORMED)
    assert ("decision/a1", "user/u2") in ends(Bond.ASSOCIATED, role="approver")
    assert any(r.third == "plan/r1" and r.later == "run/r1" for r in GRAPH.relations)


def test_an_update_leaves_a_state_with_what_was_set() -> None:
    assert GRAPH.nodes["state/n-heater/4"].facts == {"temp c": 60.5}
    assert ("state/n-heater/4", "transaction/t4") in ends(Bond.GENERATED)


def test_a_read_leaves_a_reading_of_the_device() -> None:
    assert GRAPH.nodes["reading/t5"].facts == {"ph": 7.01}
    assert ("reading/t5", "device/d-ph") in ends(Bond.ATTRIBUTED)
    assert ("transaction/t5", "resource/n-ph") in ends(Bond.USED)


def test_a_carried_thing_is_where_it_was_put() -> None:
    assert GRAPH.nodes["state/v-reactor/6"].place == "resource/n-bench"
    assert ("transaction/t6", "state/n-heater/4") in ends(Bond.USED, role="source")
    assert ("transaction/t6", "state/v-reactor/3") in ends(Bond.USED, role="subject")
    assert ("transaction/t6", "user/u1") in ends(Bond.ASSOCIATED)


def test_what_is_in_doubt_left_no_state_and_names_who_resolved_it() -> None:
    assert not {later for later, act in ends(Bond.GENERATED) if act == "transaction/t7"}
    assert ("transaction/t7", "state/v-reactor/6") in ends(Bond.USED)
    assert ("job/j7", "user/u2") in ends(Bond.ASSOCIATED, role="resolver")


def test_a_rack_has_its_tubes_as_members_and_a_run_its_files() -> None:
    assert ends(Bond.MEMBER) == {("resource/n-rack", "resource/v-reactor")}
    assert ends(Bond.GENERATED) >= {(f"file/{'0' * 64}", "run/r1")}


def test_create_and_delete_begin_and_end_a_resource() -> None:
    create = replace(
        TRANSACTIONS[0], operation={"op": "create", "resource_id": "n-bench"}, id="c", seq=1
    )
    operation = {"op": "delete", "resource_id": "n-bench", "archive_id": "n-rack"}
    delete = replace(TRANSACTIONS[0], name="delete", operation=operation, id="d", seq=2)
    graph = build_graph(replace(RECORD, flows=(), transactions=(create, delete)))
    found = {(r.bond, r.later, r.earlier) for r in graph.relations}
    assert (Bond.GENERATED, "resource/n-bench", "transaction/c") in found
    assert (Bond.INVALIDATED, "resource/n-bench", "transaction/d") in found


def test_what_is_not_described_is_left_out() -> None:
    few = [r for r in RECORD.resources if r.id != "v-syringe"]
    graph = build_graph(replace(RECORD, resources=few, runs=(), hosts={}))
    assert "resource/v-syringe" not in graph.nodes
    assert not {n for n in graph.nodes if n.startswith(("run/", "host/", "plan/"))}


def test_a_relation_with_a_wrong_end_is_a_mistake_of_the_builder() -> None:
    entity = ProvNode(id="e", kind=ProvKind.ENTITY, type="lot", name="")
    for relation in (
        Relation(bond=Bond.USED, later="e", earlier="e"),
        Relation(bond=Bond.DERIVED, later="e", earlier="gone"),
        Relation(bond=Bond.DERIVED, later="e", earlier="e", third="gone"),
    ):
        with pytest.raises(ValueError, match="e: "):
            make_graph("e", [entity], [relation])


def test_what_a_reader_may_not_know_keeps_its_form_and_loses_its_words() -> None:
    shut = redacted(GRAPH, {"job/j2", "state/v-reactor/6"})
    assert shut.nodes["job/j2"].name == "elsewhere"
    assert (shut.nodes["job/j2"].facts, shut.nodes["state/v-reactor/6"].place) == ({}, "")
    assert shut.relations == GRAPH.relations
    assert shut.nodes["job/j3"] == GRAPH.nodes["job/j3"]


def test_rows_begin_with_what_happened_in_order_of_time() -> None:
    rows = to_rows(GRAPH)
    times = [row[3] for row in rows if row[0] == "activity"]
    assert times == sorted(times)
    assert [row[0] for row in rows[: len(times)]] == ["activity"] * len(times)
    assert ("activity", "transaction", "transfer", at(2), at(3), "transaction/t2") in rows


def test_plain_data_holds_every_node_and_relation() -> None:
    plain = to_json(GRAPH)
    assert plain["root"] == "resource/v-reactor"
    assert len(plain["nodes"]) == len(GRAPH.nodes)
    assert len(plain["relations"]) == len(GRAPH.relations)


def test_a_drawing_quotes_names() -> None:
    drawing = to_dot(GRAPH)
    assert drawing.startswith("digraph provenance {")
    assert 'label="job\\nRead the \\"pH\\""' in drawing
    assert drawing.count(" -> ") == len(GRAPH.relations)
