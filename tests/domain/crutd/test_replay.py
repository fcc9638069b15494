"""The fold over events, and the ledger's arithmetic."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.crutd.event_replay import (
    Dated,
    Happening,
    Replay,
    as_of,
    begin,
    differences,
    fold,
)
from labweb.domain.crutd.ledger import (
    Account,
    Amount,
    Posting,
    book,
    posted,
    posting_from,
    unbalanced,
    vessel_of,
    vessels_of,
)
from labweb.domain.errors import ReconcileError
from labweb.domain.graph.lab_file.lab_model import LabFile, LabMode
from labweb.domain.resources.contents_by_lot import LotId, Phase
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import Nature

LAB, BENCH, BOTTLE, FLASK = (UUID(int=number) for number in range(1, 5))
WATER = LotId("water")
PARENTS = {LAB: None, BENCH: LAB, BOTTLE: BENCH, FLASK: BENCH}
KINDS = {LAB: "lab", BENCH: "bench", BOTTLE: "bottle", FLASK: "flask"}


def lab() -> LabFile:
    """Draw: lab > bench > bottle, flask."""
    nodes = tuple(
        Resource(
            id=node, key=KINDS[node], name=KINDS[node].title(), kind=KINDS[node],
            nature=Nature.RESOURCE, parent_id=PARENTS[node],
        )
        for node in PARENTS
    )  # fmt: skip
    return LabFile(id=LAB, name="Lab", time_zone="UTC", mode=LabMode.SIM, resources=nodes)


def event(seq: int, transaction: str = "t", **change: Any) -> Happening:  # noqa: ANN401
    plain = {
        "state": "committed", "postings": [], "data": {}, "moves": {}, "archived": [],
        "quarantined": [], "created": [], "released": [],
    }  # fmt: skip
    body = {"operation": {}, "change": plain | change}
    return Happening(seq=seq, transaction_id=transaction, body=body)


def pour(amount_nl: int, debit: str, credit: str) -> dict[str, Any]:
    return Posting(WATER, debit, credit, amount_nl).to_json()


def test_matter_and_places_follow_the_events() -> None:
    replay = fold(
        begin(lab()),
        [
            event(1, "a", postings=[pour(10, "RECEIPT", str(BOTTLE))]),
            event(2, "b", postings=[pour(4, str(BOTTLE), str(FLASK))]),
            event(3, "c", moves={str(FLASK): str(LAB)}, data={str(BENCH): {"note": "x"}}),
            event(4, "d", state="quarantined", quarantined=[str(BOTTLE)]),
        ],
    )
    assert replay.contents(BOTTLE) == {WATER: Amount(6)}
    assert replay.contents(FLASK) == {WATER: Amount(4)}
    assert replay.nodes[FLASK].parent_id == LAB
    assert replay.nodes[BENCH].data == {"note": "x"}
    assert replay.nodes[BOTTLE].quarantined_by == "d"
    assert replay.states == dict(zip("abcd", ["committed"] * 3 + ["quarantined"], strict=True))
    assert not list(unbalanced(replay.balances))
    fold(replay, [event(5, "d", state="rolled_back", released=[str(BOTTLE)])])
    assert replay.nodes[BOTTLE].quarantined_by is None
    assert replay.states["d"] == "rolled_back"


@pytest.mark.parametrize(
    "change",
    [
        {"moves": {str(UUID(int=9)): str(LAB)}},
        {"state": "done"},
        {"postings": [{"lot": "water"}]},
        {"created": [str(FLASK)]},
        {"quarantined": ["nowhere"]},
    ],
)
def test_an_event_that_makes_no_sense_is_refused_by_number(change: dict[str, Any]) -> None:
    with pytest.raises(ReconcileError, match="event 7") as refusal:
        fold(begin(lab()), [event(7, **change)])
    assert (refusal.value.code, refusal.value.context) == ("rebuild.unreadable", {"seq": 7})


def test_a_live_transaction_has_no_event_and_is_no_difference() -> None:
    told, kept = begin(lab()), begin(lab())
    kept.states = {"t": "locked"}
    assert differences(told, kept) == []
    for state in ("committed", "rolled_back", "quarantined"):
        kept.states = {"t": state}
        assert [one.code for one in differences(told, kept)] == ["rebuild.state"]


def test_a_node_that_only_one_side_knows_is_a_difference() -> None:
    told, kept = begin(lab()), begin(lab())
    del kept.nodes[FLASK]
    assert [one.subject for one in differences(told, kept)] == [str(FLASK)]
    assert [one.subject for one in differences(kept, told)] == [str(FLASK)]


def test_an_account_is_nominal_or_a_vessel() -> None:
    assert all(vessel_of(account.value) is None for account in Account)
    assert vessel_of(str(FLASK)) == FLASK
    with pytest.raises(ValueError, match="badly formed"):
        vessel_of("STOCK")


POSTINGS = st.lists(
    st.builds(
        posted,
        st.sampled_from([LotId("a"), LotId("b")]),
        st.just(Phase.SOLID) | st.just(Phase.LIQUID),
        debit=st.sampled_from([*Account, str(FLASK)]),
        credit=st.sampled_from([str(BOTTLE), str(BENCH)]),
        amount=st.integers(1, 2**62),
    ),
    max_size=30,
)


@given(POSTINGS)
def test_whatever_is_posted_every_lot_sums_to_zero(postings: list[Posting]) -> None:
    balances: dict[tuple[str, LotId], Amount] = {}
    book(balances, postings)
    assert not list(unbalanced(balances))
    assert all(balances.values())
    assert [posting_from(posting.to_json()) for posting in postings] == postings
    assert vessels_of(postings) <= {FLASK, BOTTLE, BENCH}


def test_a_lot_that_does_not_sum_to_zero_is_named() -> None:
    balances = {("RECEIPT", WATER): Amount(-10), (str(FLASK), WATER): Amount(9, 1)}
    assert list(unbalanced(balances)) == [(WATER, Amount(-1, 1))]


def test_an_empty_replay_of_nothing_is_nothing() -> None:
    assert fold(Replay(), []) == Replay()


def dated(seq: int, at_s: float, *about: UUID, transaction: str = "") -> Dated:
    made = event(seq, transaction or f"t{seq}")
    return Dated(event=made, at=datetime.fromtimestamp(at_s, UTC), subjects=frozenset(about))


def seqs_as_of(events: list[Dated], at_s: float, seq: int | None = None) -> list[int]:
    return [one.seq for one in as_of(events, datetime.fromtimestamp(at_s, UTC), seq)]


def test_what_was_heard_of_later_counts_from_when_it_happened() -> None:
    events = [dated(1, 0, LAB), dated(2, 50, BENCH), dated(3, 20, BOTTLE), dated(4, 30, FLASK)]
    assert seqs_as_of(events, 25) == [1, 3]
    assert seqs_as_of(events, 50) == [1, 2, 3, 4]


def test_what_counts_on_something_to_come_is_left_out_with_it() -> None:
    events = [
        dated(1, 50, BOTTLE), dated(2, 20, BOTTLE, FLASK), dated(3, 21, FLASK), dated(4, 22, BENCH),
    ]  # fmt: skip
    assert seqs_as_of(events, 30) == [4]


def test_a_transaction_is_not_ended_before_its_doubt() -> None:
    events = [dated(1, 50, BOTTLE, transaction="t"), dated(2, 20, FLASK, transaction="t")]
    assert seqs_as_of(events, 30) == []


def test_of_one_moment_the_place_in_the_chain_decides() -> None:
    events = [dated(1, 10, BOTTLE), dated(2, 10, FLASK), dated(3, 10, BENCH)]
    assert seqs_as_of(events, 10, 2) == [1, 2]
    assert seqs_as_of(events, 10) == [1, 2, 3]
