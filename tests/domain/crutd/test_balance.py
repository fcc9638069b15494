"""Mass balance and yield, from entries and reactions alone."""

from __future__ import annotations

from uuid import UUID, uuid5

import msgspec
import pytest

from labweb.domain.crutd.mass_balance import LotFacts, MassMove, find_yields, mass_balance
from labweb.domain.crutd.operations import Product, React, ReactantShare
from labweb.domain.resources.contents_by_lot import LotId, Phase

SPACE = UUID("7a3c1d52-4f7b-5a57-8a4c-2d9b6f2f0c11")
FLASK, BOTTLE, WASTE = (str(uuid5(SPACE, name)) for name in ("flask", "bottle", "waste"))


def lot(key: str) -> LotId:
    return LotId(str(uuid5(SPACE, key)))


def facts(**more: LotFacts) -> dict[LotId, LotFacts]:
    known = {
        "ether": LotFacts(key="ether", density_mg_ul=0.7, concentration_mmol_l=9500.0),
        "acid": LotFacts(key="acid", density_mg_ul=1.0, concentration_mmol_l=1000.0),
        "ester": LotFacts(key="ester", density_mg_ul=1.1, concentration_mmol_l=5000.0),
        "amide": LotFacts(key="amide", density_mg_ul=1.2, concentration_mmol_l=4000.0),
        "dye": LotFacts(key="dye"),
    }
    return {lot(key): one for key, one in {**known, **more}.items()}


def reaction(consumed: str, made: str, *, nl: int, basis: bool = True) -> React:
    return React(
        resource_id=UUID(FLASK),
        reactants=(ReactantShare(lot_id=UUID(lot(consumed)), amount_nl=nl),),
        products=(
            Product(
                lot_id=UUID(lot(made)), material_id=SPACE, key=made, phase=Phase.LIQUID, amount_nl=1
            ),
        ),
        reason="told",
        basis=UUID(lot(consumed)) if basis else msgspec.UNSET,
    )


def test_what_passes_through_a_syringe_is_on_neither_side() -> None:
    syringe = str(uuid5(SPACE, "syringe"))
    moves = [
        MassMove(lot("ether"), BOTTLE, syringe, 1000),
        MassMove(lot("ether"), syringe, FLASK, 1000),
    ]
    balance = mass_balance(moves, facts())
    assert [(c.account, c.total_ug) for c in balance.taken] == [(BOTTLE, -700)]
    assert [(c.account, c.total_ug) for c in balance.brought] == [(FLASK, 700)]
    assert balance.gap_ug == 0


def test_the_residue_of_a_reaction_closes_the_balance() -> None:
    moves = [
        MassMove(lot("acid"), BOTTLE, FLASK, 10_000),
        MassMove(lot("acid"), FLASK, "REACTION", 10_000),
        MassMove(lot("ester"), "REACTION", FLASK, 8000),
    ]
    balance = mass_balance(moves, facts())
    brought = {change.account: change.total_ug for change in balance.brought}
    assert brought == {FLASK: 8800, "REACTION": 1200}
    assert balance.taken_ug == balance.brought_ug == 10_000


def test_a_lot_without_density_is_named_and_counted_on_neither_side() -> None:
    balance = mass_balance([MassMove(lot("dye"), BOTTLE, FLASK, 1000)], facts())
    assert balance.unknown == (lot("dye"),)
    assert balance.taken == balance.brought == ()


def test_a_yield_is_what_stands_there_on_what_was_consumed() -> None:
    # 10 µmol of acid, 8 µmol of ester.
    (found,) = find_yields(
        [reaction("acid", "ester", nl=10_000)], facts(), {lot("ester"): (1600, 0)}
    )
    assert found.basis_umol == pytest.approx(10.0)
    assert found.isolated_umol == pytest.approx(8.0)
    assert found.isolated_ug == 1760
    assert found.ratio == pytest.approx(0.8)


def test_the_yield_of_two_steps_is_on_what_began_the_first() -> None:
    two = [reaction("acid", "ester", nl=10_000), reaction("ester", "amide", nl=1000)]
    (found,) = find_yields(two, facts(), {lot("amide"): (1250, 0)})
    assert (found.product, found.basis) == (lot("amide"), lot("acid"))
    assert found.ratio == pytest.approx(0.5)


def test_a_solid_product_is_reckoned_by_its_mass() -> None:
    (found,) = find_yields(
        [reaction("acid", "ester", nl=10_000)], facts(), {lot("ester"): (0, 1760)}
    )
    assert found.isolated_umol == pytest.approx(8.0)


def test_nothing_left_is_a_yield_of_nothing() -> None:
    (found,) = find_yields([reaction("acid", "ester", nl=10_000)], facts(), {})
    assert found.ratio == 0


def test_what_is_not_stated_gives_no_yield_and_is_named() -> None:
    known = facts(ester=LotFacts(key="ester", density_mg_ul=1.1))
    (found,) = find_yields([reaction("acid", "ester", nl=10_000)], known, {lot("ester"): (1600, 0)})
    assert found.ratio is None
    assert found.missing == (lot("ester"),)


def test_a_reaction_without_a_basis_has_no_yield() -> None:
    assert find_yields([reaction("acid", "ester", nl=1, basis=False)], facts(), {}) == []
