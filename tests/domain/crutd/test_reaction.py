"""A reaction turns lots into lots; mass is what it conserves."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from typing import Any
from uuid import UUID

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.crutd import operations
from labweb.domain.crutd.ledger import book, unbalanced
from labweb.domain.crutd.operations import Product, React, ReactantShare
from labweb.domain.crutd.settlement import Outcome, OutcomeKind, check, settle
from labweb.domain.crutd.snapshot import Facts, LotState, MaterialState, ResourceState
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import StateError
from labweb.domain.resources.contents_by_lot import LotId, Phase

FLASK, ACID, BASE, SALT = (UUID(int=number) for number in range(1, 5))
SALT_MATERIAL = UUID(int=9)


def lot(identity: UUID, density: float | None, phase: Phase = Phase.LIQUID) -> LotState:
    key = f"m{identity.int}"
    material = MaterialState(key=key, name=key.title(), density_mg_ul=density)
    return LotState(id=LotId(str(identity)), name=key, phase=phase, material=material)


FLASK_STATE = ResourceState(
    id=FLASK,
    name="Flask",
    kind="vial",
    contents={LotId(str(ACID)): 10_000},
    masses={LotId(str(BASE)): 5_000},
    capacity_nl=20_000,
    capacity_ug=50_000,
)
FACTS = Facts(
    on=date(2026, 1, 1),
    lots={
        LotId(str(ACID)): lot(ACID, 1.2),
        LotId(str(BASE)): lot(BASE, None, Phase.SOLID),
    },
    materials={SALT_MATERIAL: MaterialState(key="salt", name="Salt")},
)
REACTION = React(
    resource_id=FLASK,
    reactants=(
        ReactantShare(lot_id=ACID, amount_nl=5_000),
        ReactantShare(lot_id=BASE, amount_ug=4_000),
    ),
    products=(
        Product(
            lot_id=SALT,
            material_id=SALT_MATERIAL,
            key="salt-1",
            phase=Phase.SOLID,
            amount_ug=8_500,
        ),
    ),
    residue_ug=1_500,
    reason="weighed after drying",
)
"""5 µL of acid at 1.2 mg/µL and 4 mg of base: 10 mg in, 8.5 mg of salt and 1.5 mg of water out."""


def codes(operation: React, facts: Facts | None = FACTS, **state: Any) -> list[str]:  # noqa: ANN401
    snapshot = {FLASK: replace(FLASK_STATE, **state)}
    return [finding.code for finding in check(operation, snapshot, facts)]


def but(**fields: Any) -> React:  # noqa: ANN401
    return msgspec.structs.replace(REACTION, **fields)


def product(**fields: Any) -> React:  # noqa: ANN401
    return but(products=(msgspec.structs.replace(REACTION.products[0], **fields),))


def test_a_reaction_whose_masses_agree_is_right() -> None:
    assert codes(REACTION) == []


def test_its_entries_go_through_the_account_and_sum_to_zero() -> None:
    change = settle(REACTION, {FLASK: FLASK_STATE}, Outcome(kind=OutcomeKind.DONE))
    told = {(p.lot, p.debit, p.credit, p.amount_nl, p.amount_ug) for p in change.postings}
    vessel = str(FLASK)
    assert told == {
        (str(ACID), vessel, "REACTION", 5_000, 0),
        (str(BASE), vessel, "REACTION", 0, 4_000),
        (str(SALT), "REACTION", vessel, 0, 8_500),
    }
    balances: Any = {}
    book(balances, change.postings)
    assert list(unbalanced(balances)) == []


@pytest.mark.parametrize(
    ("operation", "code"),
    [
        (but(residue_ug=0), "crutd.mass_not_conserved"),
        (product(amount_ug=10_003), "crutd.mass_not_conserved"),
        (but(reason=" "), "crutd.reason_missing"),
        (but(reactants=(ReactantShare(lot_id=SALT, amount_nl=1),)), "crutd.same_lot"),
        (but(reactants=(ReactantShare(lot_id=FLASK, amount_nl=1),)), "crutd.no_lot"),
        (
            but(reactants=(ReactantShare(lot_id=ACID, amount_nl=10_001),)),
            "crutd.insufficient_volume",
        ),
        (but(reactants=(ReactantShare(lot_id=BASE, amount_ug=5_001),)), "crutd.insufficient_mass"),
        (but(reactants=(ReactantShare(lot_id=BASE, amount_nl=5),)), "crutd.unit_mismatch"),
        (but(reactants=(ReactantShare(lot_id=ACID),)), "crutd.not_positive"),
        (product(amount_ug=0), "crutd.not_positive"),
        (product(amount_nl=3), "crutd.unit_mismatch"),
        (product(material_id=FLASK), "crutd.no_material"),
        (product(phase=Phase.LIQUID, amount_ug=0, amount_nl=90_000), "crutd.capacity_exceeded"),
    ],
)
def test_a_reaction_that_cannot_have_been_is_refused(operation: React, code: str) -> None:
    assert code in codes(operation)


def test_a_product_may_take_the_room_of_what_was_consumed() -> None:
    """10 µL are in a flask for 20 µL: 5 of them react, so 15 µL have room and 16 µL have not."""
    made = {"phase": Phase.LIQUID, "amount_ug": 0, "mass_ug": 8_500}
    assert codes(product(amount_nl=15_000, **made)) == []
    assert codes(product(amount_nl=15_001, **made)) == ["crutd.capacity_exceeded"]


def test_a_liquid_of_unknown_density_has_to_be_weighed() -> None:
    made = product(phase=Phase.LIQUID, amount_ug=0, amount_nl=7_000)
    assert codes(made) == ["crutd.unknown_density"]
    weighed = product(phase=Phase.LIQUID, amount_ug=0, amount_nl=7_000, mass_ug=8_500)
    assert codes(weighed) == []


def test_a_stated_density_counts_and_not_a_second_figure() -> None:
    shares = (ReactantShare(lot_id=ACID, amount_nl=5_000, mass_ug=1), REACTION.reactants[1])
    assert codes(but(reactants=shares)) == []


def test_a_product_takes_no_lot_that_is_there() -> None:
    assert codes(REACTION, replace(FACTS, taken_lots=frozenset({SALT}))) == ["crutd.lot_taken"]


def test_a_reaction_needs_a_vessel_that_is_free_of_doubt() -> None:
    assert codes(REACTION, kind="bench") == ["crutd.no_vessel"]
    assert codes(REACTION, quarantined_by="t") == ["crutd.quarantined"]


def test_an_edge_host_checks_what_is_in_the_vessel_without_facts_of_lots() -> None:
    assert codes(REACTION, None) == []
    assert codes(but(reactants=(ReactantShare(lot_id=ACID, amount_nl=10_001),)), None) == [
        "crutd.insufficient_volume"
    ]


def test_a_reaction_that_was_broken_off_leaves_its_vessel_to_a_person() -> None:
    for kind in (OutcomeKind.PARTIAL, OutcomeKind.UNKNOWN):
        change = settle(REACTION, {FLASK: FLASK_STATE}, Outcome(kind=kind))
        assert change.state is TransactionState.QUARANTINED
        assert change.quarantined == {FLASK}
        assert change.postings == ()


def test_more_cannot_have_reacted_than_was_there() -> None:
    emptied = replace(FLASK_STATE, contents={})
    with pytest.raises(StateError, match="more of lot"):
        settle(REACTION, {FLASK: emptied}, Outcome(kind=OutcomeKind.DONE))


def test_it_is_read_as_it_was_written_and_bounds_hold() -> None:
    plain = operations.to_json(REACTION)
    assert operations.from_json(plain) == REACTION
    assert operations.touched_ids(REACTION) == (FLASK,)
    refused: list[dict[str, object]] = [
        {"residue_ug": -1}, {"residue_ug": 10**15}, {"products": []}, {"reactants": []},
    ]  # fmt: skip
    for wrong in refused:
        with pytest.raises(msgspec.ValidationError):
            operations.from_json({**plain, **wrong})
    with pytest.raises(msgspec.ValidationError):
        operations.from_json({**plain, "residue_ug": float("nan")})


@given(
    consumed=st.integers(1, 10_000),
    mass=st.integers(1, 5_000),
    share=st.floats(0.01, 1.0),
)
def test_what_is_declared_whole_is_accepted_and_one_milligram_off_is_not(
    consumed: int, mass: int, share: float
) -> None:
    total = round(consumed * 1.2) + mass
    made = max(1, int(total * share))
    right = but(
        reactants=(
            ReactantShare(lot_id=ACID, amount_nl=consumed),
            ReactantShare(lot_id=BASE, amount_ug=mass),
        ),
        products=(msgspec.structs.replace(REACTION.products[0], amount_ug=made),),
        residue_ug=total - made,
    )
    assert codes(right) == []
    wrong = msgspec.structs.replace(right, residue_ug=right.residue_ug + 1_000)
    assert codes(wrong) == ["crutd.mass_not_conserved"]


def test_an_edge_host_that_keeps_no_solids_settles_the_same() -> None:
    known = {FLASK: replace(FLASK_STATE, masses={}, capacity_ug=None, knows_masses=False)}
    assert check(REACTION, known, None) == []
    here = settle(REACTION, known, Outcome(kind=OutcomeKind.DONE))
    there = settle(REACTION, {FLASK: FLASK_STATE}, Outcome(kind=OutcomeKind.DONE))
    assert here.to_json() == there.to_json()
