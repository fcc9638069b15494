"""A reaction in a vessel: lots go into the account REACTION, product lots come out of it.

Volume is not conserved by a reaction, mass is. So the balance is struck in micrograms: what was
consumed is what was made, products and residue together. A lot that is counted by volume has the
mass that its density gives; where nobody stated a density, it has to be weighed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from labweb.domain.crutd.ledger import Account, Posting, posted
from labweb.domain.crutd.operations import Product, React, ReactantShare
from labweb.domain.crutd.receive_correct_dispose import check_room
from labweb.domain.crutd.snapshot import Facts, ResourceState, Snapshot
from labweb.domain.errors import Finding
from labweb.domain.resources.contents_by_lot import Contents, LotId, Phase
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.domain.units import render_mass, render_volume

_ROUNDING_UG = 1
"""By which each mass may be off: volumes become whole micrograms."""


def check_react(operation: React, snapshot: Snapshot, facts: Facts | None) -> list[Finding]:
    """List why a reaction cannot have happened as it is told.

    Neither the last day of a lot nor what it must not meet counts: what has reacted has reacted,
    and the record says so. An edge host has no facts of lots; the server has checked them.
    """
    state = snapshot[operation.resource_id]
    if not is_vessel(state.kind):
        return [Finding("crutd.no_vessel", f"{state.name} holds nothing", state.name)]
    findings = [*_check_said(operation, state)]
    for share in operation.reactants:
        findings += _check_share(share, state, facts)
    for product in operation.products:
        findings += _check_product(product, facts)
    findings += _check_products_fit(operation, state)
    if findings or facts is None:
        return findings
    return [*_check_mass(operation, state, facts)]


def _check_said(operation: React, state: ResourceState) -> Iterator[Finding]:
    if not operation.reason.strip():
        text = "a reaction needs a reason: how it is known what was made, and how much"
        yield Finding("crutd.reason_missing", text, state.name)
    named = [*(s.lot_id for s in operation.reactants), *(p.lot_id for p in operation.products)]
    if len(set(named)) != len(named):
        yield Finding("crutd.same_lot", "a lot is named twice", state.name)
    if operation.basis and operation.basis not in {s.lot_id for s in operation.reactants}:
        text = "the lot that the yield is on is none of the reactants"
        yield Finding("crutd.no_lot", text, state.name, {"lot_id": str(operation.basis)})
    keys = [product.key for product in operation.products]
    if len(set(keys)) != len(keys):
        yield Finding("crutd.same_lot", "two products have one key", state.name)


def _check_share(
    share: ReactantShare, state: ResourceState, facts: Facts | None
) -> Iterator[Finding]:
    lot = LotId(str(share.lot_id))
    context = {"lot_id": lot, "resource_id": str(state.id)}
    is_liquid = lot in state.contents
    if not is_liquid and share.amount_ug and not state.knows_masses:
        return
    if not is_liquid and lot not in state.masses:
        text = f"{state.name} holds nothing of lot {_name(lot, facts)}"
        yield Finding("crutd.no_lot", text, state.name, context)
        return
    asked, other = _in_unit(share, Phase.LIQUID if is_liquid else Phase.SOLID)
    if other:
        text = f"{_name(lot, facts)} is counted in {'nl' if is_liquid else 'ug'}"
        yield Finding("crutd.unit_mismatch", text, state.name, context)
    elif asked <= 0:
        yield Finding("crutd.not_positive", "0 is no amount", state.name, context)
    there = state.contents[lot] if is_liquid else state.masses[lot]
    if asked > there:
        code = "crutd.insufficient_volume" if is_liquid else "crutd.insufficient_mass"
        told = render_volume(there) if is_liquid else render_mass(there)
        text = f"{state.name} holds {told} of {_name(lot, facts)}"
        yield Finding(code, text, state.name, context)


def _in_unit(one: ReactantShare | Product, phase: Phase) -> tuple[int, int]:
    """Return the amount in the unit of a phase, and the one in the other unit."""
    amounts = (one.amount_nl, one.amount_ug)
    return amounts if phase is Phase.LIQUID else (amounts[1], amounts[0])


def _name(lot: LotId, facts: Facts | None) -> str:
    known = None if facts is None else facts.lots.get(lot)
    return str(lot) if known is None else known.name


def _check_product(product: Product, facts: Facts | None) -> Iterator[Finding]:
    asked, other = _in_unit(product, product.phase)
    if other:
        text = f"a {product.phase.value} is counted in {product.phase.unit}"
        yield Finding("crutd.unit_mismatch", text, product.key)
    elif asked <= 0:
        yield Finding("crutd.not_positive", "0 is no amount", product.key)
    if facts is None:
        return
    if product.material_id not in facts.materials:
        text = f"no material {product.material_id}"
        yield Finding("crutd.no_material", text, str(product.material_id))
    if product.lot_id in facts.taken_lots:
        text = f"a lot with the id or the key {product.key!r} is there already"
        yield Finding("crutd.lot_taken", text, product.key)


def _check_products_fit(operation: React, state: ResourceState) -> Iterator[Finding]:
    """See whether the products have room once the reactants are gone."""
    left = replace(
        state,
        contents=_without(state.contents, operation.reactants),
        masses=_without(state.masses, operation.reactants),
    )
    liquid = sum(p.amount_nl for p in operation.products if p.phase is Phase.LIQUID)
    mass = sum(p.amount_ug for p in operation.products if p.phase is not Phase.LIQUID)
    if liquid:
        yield from check_room(left, liquid, Phase.LIQUID)
    if mass and state.knows_masses:
        yield from check_room(left, mass, Phase.SOLID)


def _without(held: Contents, shares: Sequence[ReactantShare]) -> dict[LotId, int]:
    left = dict(held)
    for share in shares:
        lot = LotId(str(share.lot_id))
        if lot in left:
            left[lot] = max(0, left[lot] - (share.amount_nl or share.amount_ug))
    return left


def _check_mass(operation: React, state: ResourceState, facts: Facts) -> Iterator[Finding]:
    consumed, made = 0, operation.residue_ug
    for share in operation.reactants:
        known = facts.lots.get(LotId(str(share.lot_id)))
        density = None if known is None else known.material.density_mg_ul
        mass = mass_of(share, density)
        if mass is None:
            yield _unweighed(_name(LotId(str(share.lot_id)), facts))
            return
        consumed += mass
    for product in operation.products:
        mass = mass_of(product, facts.materials[product.material_id].density_mg_ul)
        if mass is None:
            yield _unweighed(product.key)
            return
        made += mass
    count = len(operation.reactants) + len(operation.products)
    if abs(consumed - made) <= count * _ROUNDING_UG:
        return
    if made > consumed:
        more = "more than was consumed; what came from outside is received into the vessel first"
    else:
        more = "less than was consumed; say what else was made as residue"
    yield Finding(
        "crutd.mass_not_conserved",
        f"{consumed / 1000:g} mg were consumed, {made / 1000:g} mg are told as made: {more}",
        state.name,
        {"consumed_ug": consumed, "made_ug": made},
    )


def mass_of(one: ReactantShare | Product, density_mg_ul: float | None) -> int | None:
    """Return the mass of an amount in whole micrograms; None: nobody can tell.

    A density in mg/µL is the same figure in µg/nL. What was weighed counts only where no density
    is stated, so that two figures for one amount never stand against each other.
    """
    if not one.amount_nl:
        return one.amount_ug
    if density_mg_ul is None:
        return one.mass_ug
    return round(one.amount_nl * density_mg_ul)


def _unweighed(name: str) -> Finding:
    text = f"nobody stated the density of {name}: give its mass in mass_ug"
    return Finding("crutd.unknown_density", text, name)


def react_postings(operation: React) -> tuple[Posting, ...]:
    """Return the entries of a reaction; the caller has checked that its vessel holds them."""
    vessel, account = str(operation.resource_id), Account.REACTION.value
    consumed = [
        posted(
            LotId(str(share.lot_id)),
            Phase.LIQUID if share.amount_nl else Phase.SOLID,
            debit=vessel,
            credit=account,
            amount=share.amount_nl or share.amount_ug,
        )
        for share in operation.reactants
    ]
    made = [
        posted(
            LotId(str(product.lot_id)),
            product.phase,
            debit=account,
            credit=vessel,
            amount=product.amount_nl or product.amount_ug,
        )
        for product in operation.products
    ]
    return (*consumed, *made)
