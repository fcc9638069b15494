"""A step at whose end a reaction is on record: its reactants gone, its product a new lot.

```text
acid-1, base-1 ──▶ reactor ──▶ REACTION ──▶ reactor: salt-1
```
"""

from __future__ import annotations

from uuid import UUID, uuid5

import msgspec

from labweb.domain.crutd.operations import Product, React, ReactantShare
from labweb.domain.errors import UnitError
from labweb.domain.resources.contents_by_lot import LotId, Phase
from labweb.domain.units import parse_mass_ug, parse_volume_nl
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import draft_of, wait_job
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftStep
from labweb.domain.workflows.workflow_file import Step


def plan_react(step: Step, drafting: Drafting) -> DraftStep:
    """Wait with the vessel locked; the end of the wait records the reaction.

    Amounts are those that the person states, and nothing is inferred from what the vessel
    holds. One that is broken off quarantines its vessel.
    """
    shares, products = _shares(step, drafting), _products(step, drafting)
    basis = _basis(step, drafting)
    if not products or basis is None or len(shares) != len(step.params["consumed"]):
        return DraftStep(step=step)
    vessel = UUID(step.params["vessel"])
    operation = React(
        resource_id=vessel,
        reactants=shares,
        products=products,
        residue_ug=parse_mass_ug(step.params["residue"]) if "residue" in step.params else 0,
        reason=step.params["reason"],
        basis=basis,
    )
    sentence = f"Let {drafting.name(vessel)} react to {products[0].key}"
    return draft_of(
        step, [wait_job(step, drafting, (vessel,), sentence=sentence, operation=operation)]
    )


def _shares(step: Step, drafting: Drafting) -> tuple[ReactantShare, ...]:
    view, shares = drafting.view, []
    consumed = step.params["consumed"]
    if not 0 < len(consumed) <= 100:
        drafting.refuse(step, "plan.no_reactant", "name 1 to 100 lots that react", _CONSUMED)
    for key, text in sorted(consumed.items()):
        lot = drafting.lot(key)
        known = None if lot is None or view.facts is None else view.facts.lots.get(lot)
        phase = drafting.phases.get(key) if known is None else known.phase
        if lot is None or phase is None:
            drafting.refuse(step, "plan.no_lot", f"this lab has no lot {key!r}", _CONSUMED, lot=key)
            continue
        try:
            if phase is Phase.LIQUID:
                shares.append(ReactantShare(lot_id=UUID(lot), amount_nl=parse_volume_nl(text)))
            else:
                shares.append(ReactantShare(lot_id=UUID(lot), amount_ug=parse_mass_ug(text)))
        except UnitError as error:
            drafting.refuse(step, error.code, f"{key}: {error.message}", _CONSUMED, lot=key)
    return tuple(shares)


def _basis(step: Step, drafting: Drafting) -> UUID | msgspec.UnsetType | None:
    """Return the lot that the yield is on; unset where none is named, None where none is there."""
    key = step.params.get("basis")
    if key is None:
        return msgspec.UNSET
    lot = drafting.lot(key)
    if lot is None or key not in step.params["consumed"]:
        message = f"the yield cannot be on {key!r}: it is none of the lots that react"
        drafting.refuse(step, "plan.no_lot", message, "params.basis", lot=key)
        return None
    return UUID(lot)


def _products(step: Step, drafting: Drafting) -> tuple[Product, ...]:
    """Return the product and what is made beside it; nothing when one of them is refused."""
    params = step.params
    if ("volume" in params) == ("mass" in params):
        message = "say the volume of a liquid product, or the mass of a solid one"
        drafting.refuse(step, "plan.product_amount", message, "params.mass")
        return ()
    amount = params.get("volume") or params["mass"]
    wanted = [(params["product"], f"{amount} {params['material']}", "params.material")]
    beside = params.get("beside", {})
    wanted += [(key, text, "params.beside") for key, text in sorted(beside.items())]
    made = [_product(step, drafting, *one) for one in wanted]
    found = tuple(product for product in made if product is not None)
    if len(found) < len(made):
        return ()
    for product in found:
        drafting.products[product.key] = LotId(str(product.lot_id))
        drafting.phases[product.key] = product.phase
    return found


def _product(step: Step, drafting: Drafting, key: str, text: str, at: str) -> Product | None:
    """Read `27 mL thf`: the amount of a new lot, and the key of its material."""
    view = drafting.view
    amount, _, material = str(text).rpartition(" ")
    material_id, found = view.materials.get(material), len(drafting.findings)
    if material_id is None:
        message = f"this lab has no material {material!r}"
        drafting.refuse(step, "plan.no_material", message, at)
    if drafting.lot(key) is not None:
        message = f"there is a lot {key!r} already: name the new one otherwise"
        field = "params.product" if at == "params.material" else at
        drafting.refuse(step, "crutd.lot_taken", message, field)
    volume_nl, mass_ug = 0, 0
    try:
        volume_nl = parse_volume_nl(amount)
    except UnitError:
        try:
            mass_ug = parse_mass_ug(amount)
        except UnitError as error:
            drafting.refuse(step, error.code, f"{key}: {error.message}", at)
    if material_id is None or len(drafting.findings) > found:
        return None
    return Product(
        lot_id=uuid5(view.tree.children[None][0].id, f"lot/{key}"),
        material_id=material_id,
        key=key,
        phase=Phase.LIQUID if volume_nl else Phase.SOLID,
        amount_nl=volume_nl,
        amount_ug=mass_ug,
    )


_CONSUMED = "params.consumed"
