"""Where matter came from and what became of it."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.crutd.provenance.lineage import Limits, trace_down, trace_flows, trace_up
from labweb.domain.crutd.provenance.lineage_picture import to_graph
from tests.domain.crutd.provenance.ledgers import Book, flow, links, reader

FAR = Limits(depth=10_000, size=10_000)
VESSELS = ("v-a", "v-b", "v-c", "v-d", "v-e")
LOTS = ("water", "acid", "dye")
ACTS = st.lists(
    st.one_of(
        st.tuples(st.just("deliver"), st.sampled_from(VESSELS), st.sampled_from(LOTS)),
        st.tuples(st.just("pour"), st.sampled_from(VESSELS), st.sampled_from(VESSELS)),
    ),
    max_size=40,
)
AMOUNTS = st.lists(st.integers(1, 12), min_size=40, max_size=40)


def a_book(acts: list[tuple[str, str, str]], amounts: list[int]) -> Book:
    book = Book()
    for (name, one, other), amount in zip(acts, amounts, strict=False):
        getattr(book, name)(one, other, amount)
    return book


@given(ACTS, AMOUNTS)
def test_lineage_up_is_what_marks_on_every_drop_would_tell(
    acts: list[tuple[str, str, str]], amounts: list[int]
) -> None:
    book = a_book(acts, amounts)
    for vessel in VESSELS:
        trace = trace_up(vessel, reader(book.flows), FAR)
        assert links(trace.flows) == book.last_marks.get(vessel, set()), vessel
        assert trace.is_whole


@given(ACTS, AMOUNTS)
def test_lineage_down_is_every_flow_that_carried_something_of_the_vessel(
    acts: list[tuple[str, str, str]], amounts: list[int]
) -> None:
    book = a_book(acts, amounts)
    for vessel in VESSELS:
        trace = trace_down(vessel, reader(book.flows), FAR)
        assert links(trace.flows) == book.touched.get(vessel, set()), vessel


@settings(max_examples=50, deadline=None)
@given(ACTS, AMOUNTS, st.integers(0, 4), st.integers(1, 10))
def test_a_bounded_walk_is_part_of_the_whole_and_says_that_it_is_cut(
    acts: list[tuple[str, str, str]], amounts: list[int], depth: int, size: int
) -> None:
    book = a_book(acts, amounts)
    for vessel in VESSELS:
        whole = trace_up(vessel, reader(book.flows), FAR)
        part = trace_up(vessel, reader(book.flows), Limits(depth=depth, size=size))
        assert links(part.flows) <= links(whole.flows)
        assert part.is_whole == (links(part.flows) == links(whole.flows))


def test_what_was_washed_out_is_no_ancestor() -> None:
    """water ──▶ syringe ──▶ flask; then acid ──▶ syringe ──▶ reactor."""
    flows = [
        flow(1, "RECEIPT", "v-water", water=9),
        flow(2, "RECEIPT", "v-acid", acid=9),
        flow(3, "v-water", "v-syringe", water=5),
        flow(4, "v-syringe", "v-flask", water=5),
        flow(5, "v-acid", "v-syringe", acid=3),
        flow(6, "v-syringe", "v-reactor", acid=3),
    ]
    assert links(trace_up("v-reactor", reader(flows), FAR).flows) == {
        (2, "acid"), (5, "acid"), (6, "acid"),
    }  # fmt: skip


def test_of_the_same_lot_only_what_was_still_there_counts() -> None:
    """Two bottles of one lot go through one syringe, which is emptied in between."""
    flows = [
        flow(1, "RECEIPT", "v-one", water=9),
        flow(2, "RECEIPT", "v-two", water=9),
        flow(3, "v-one", "v-syringe", water=5),
        flow(4, "v-syringe", "v-waste", water=5),
        flow(5, "v-two", "v-syringe", water=5),
        flow(6, "v-syringe", "v-reactor", water=5),
    ]
    found = links(trace_up("v-reactor", reader(flows), FAR).flows)
    assert found == {(2, "water"), (5, "water"), (6, "water")}


def test_what_was_poured_in_later_is_no_ancestor() -> None:
    flows = [
        flow(1, "RECEIPT", "v-a", water=9),
        flow(2, "v-a", "v-b", water=2),
        flow(3, "RECEIPT", "v-a", dye=9),
        flow(4, "v-a", "v-c", water=1, dye=1),
    ]
    assert links(trace_up("v-b", reader(flows), FAR).flows) == {(1, "water"), (2, "water")}


def test_of_an_empty_vessel_its_last_contents_are_told() -> None:
    flows = [
        flow(1, "RECEIPT", "v-a", water=9),
        flow(2, "v-a", "v-b", water=2),
        flow(3, "v-b", "v-c", water=2),
    ]
    assert links(trace_up("v-b", reader(flows), FAR).flows) == {(1, "water"), (2, "water")}
    assert trace_up("v-none", reader(flows), FAR).flows == ()


def test_a_product_comes_from_its_reactants() -> None:
    """acid + base ──▶ REACTION ──▶ salt, in one act inside the reactor."""
    flows = [
        flow(1, "RECEIPT", "v-acid", acid=9),
        flow(2, "RECEIPT", "v-base", base=9),
        flow(3, "v-acid", "v-reactor", acid=4),
        flow(4, "v-base", "v-reactor", base=4),
        flow(5, "v-reactor", "REACTION", activity="react", acid=4, base=4),
        flow(6, "REACTION", "v-reactor", activity="react", salt=7),
        flow(7, "v-reactor", "v-flask", salt=7),
    ]
    up = links(trace_up("v-flask", reader(flows), FAR).flows)
    assert {order for order, _ in up} == {1, 2, 3, 4, 5, 6, 7}
    down = links(trace_down("v-acid", reader(flows), FAR).flows)
    assert {order for order, _ in down} == {3, 5, 6, 7}


def test_all_that_was_made_from_a_delivery_is_found_from_its_receipt() -> None:
    flows = [
        flow(1, "RECEIPT", "v-a", water=9),
        flow(2, "RECEIPT", "v-a", dye=1),
        flow(3, "v-a", "v-b", water=4, dye=1),
        flow(4, "v-b", "v-c", water=4, dye=1),
    ]
    trace = trace_flows(flows[1:2], reader(flows), FAR, forward=True)
    assert links(trace.flows) == {(2, "dye"), (3, "dye"), (4, "dye")}
    assert [f.amount_nl for f in trace.flows] == [1, 1, 1]


def test_deliveries_at_the_end_of_the_depth_are_named_and_the_rest_is_counted() -> None:
    flows = [
        flow(1, "RECEIPT", "v-a", water=9),
        flow(2, "v-a", "v-b", water=4),
        flow(3, "RECEIPT", "v-b", dye=1),
        flow(4, "v-b", "v-c", water=4, dye=1),
    ]
    trace = trace_up("v-c", reader(flows), Limits(depth=1, size=99))
    assert links(trace.flows) == {(3, "dye"), (4, "water"), (4, "dye")}
    assert (trace.beyond, trace.is_whole) == (1, False)


def test_a_vessel_whose_history_is_too_long_is_named() -> None:
    flows = [
        flow(1, "RECEIPT", "v-a", water=9),
        flow(2, "v-a", "v-b", water=4),
    ]
    trace = trace_up("v-b", reader(flows, unread=["v-a"]), FAR)
    assert (set(trace.unread), trace.is_whole) == ({"v-a"}, False)
    assert links(trace.flows) == {(2, "water")}


def test_a_stay_is_told_by_the_acts_that_began_and_ended_it() -> None:
    flows = [
        flow(1, "RECEIPT", "v-a", water=9),
        flow(2, "v-a", "v-b", water=4),
        flow(3, "v-b", "v-c", water=4),
    ]
    spans = {(s.vessel, s.first, s.last) for s in trace_up("v-c", reader(flows), FAR).spans}
    assert spans == {("v-a", "t1", "t2"), ("v-b", "t2", "t3"), ("v-c", "t3", None)}
    down = {(s.vessel, s.first, s.last) for s in trace_down("v-a", reader(flows), FAR).spans}
    assert down == {("v-a", None, None), ("v-b", "t2", "t3"), ("v-c", "t3", None)}


def test_a_flow_tells_volume_and_mass_apart() -> None:
    mixed = replace(flow(1, "v-a", "v-b", water=5, salt=3), in_ug=frozenset({"salt"}))
    assert (mixed.amount_nl, mixed.amount_ug) == (5, 3)


def test_a_picture_has_each_vessel_act_and_lot_once() -> None:
    flows = [
        flow(1, "RECEIPT", "v-a", water=9),
        flow(2, "v-a", "v-b", water=4),
        flow(3, "v-b", "WASTE", water=4),
    ]
    picture = to_graph("v-b", flows)
    ids = [node["id"] for node in picture["nodes"]]
    assert sorted(ids) == ["lot:water", "t2", "t3", "v-a", "v-b"]
    assert {(e["source"], e["target"]) for e in picture["edges"]} == {
        ("lot:water", "v-a"), ("v-a", "t2"), ("t2", "v-b"), ("v-b", "t3"),
    }  # fmt: skip


def test_a_picture_tells_volume_and_mass_apart() -> None:
    brought = replace(flow(1, "RECEIPT", "v-a", water=9, salt=4), in_ug=frozenset({"salt"}))
    amounts = {
        edge["source"]: (edge["amount_nl"], edge["amount_ug"])
        for edge in to_graph("v-a", [brought])["edges"]
    }
    assert amounts == {"lot:water": (9, 0), "lot:salt": (0, 4)}
