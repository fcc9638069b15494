"""A step at whose end a reaction is on record: its reactants gone, its product a new lot.

```text
acid-1, base-1 ──▶ reactor ──▶ REACTION ──▶ reactor: salt-1
```
"""

from __future__ import annotations

from uuid import UUID, uuid5

from labweb.domain.crutd.operations import Product, React, Share
from labweb.domain.errors import UnitError
from labweb.domain.resources.contents import Phase
from labweb.domain.units import parse_mass_ug, parse_volume_nl
from labweb.domain.workflows.passes.acting import draft_of, wait_job
from labweb.domain.workflows.passes.draft import Drafting, DraftStep
from labweb.domain.workflows.protocol import Step


def plan_react(step: Step, drafting: Drafting) -> DraftStep:
    """Wait with the vessel locked; the end of the wait records the reaction.

    Amounts are those that the person states, and nothing is inferred from what the vessel
    holds. One that is broken off quarantines its vessel.
    """
    shares, product = _shares(step, drafting), _product(step, drafting)
    if product is None or len(shares) != len(step.params["consumed"]):
        return DraftStep(step=step)
    vessel = UUID(step.params["vessel"])
    operation = React(
        resource_id=vessel,
        reactants=shares,
        products=(product,),
        residue_ug=parse_mass_ug(step.params["residue"]) if "residue" in step.params else 0,
        reason=step.params["reason"],
    )
    sentence = f"Let {drafting.name(vessel)} react to {product.key}"
    return draft_of(
        step, [wait_job(step, drafting, (vessel,), sentence=sentence, operation=operation)]
    )


def _shares(step: Step, drafting: Drafting) -> tuple[Share, ...]:
    view, shares = drafting.view, []
    consumed = step.params["consumed"]
    if not 0 < len(consumed) <= 100:
        drafting.refuse(step, "plan.no_reactant", "name 1 to 100 lots that react", _CONSUMED)
    for key, text in sorted(consumed.items()):
        lot = view.lots.get(key)
        known = None if lot is None or view.facts is None else view.facts.lots.get(lot)
        if lot is None or known is None:
            drafting.refuse(step, "plan.no_lot", f"this lab has no lot {key!r}", _CONSUMED, lot=key)
            continue
        try:
            if known.phase is Phase.LIQUID:
                shares.append(Share(lot_id=UUID(lot), amount_nl=parse_volume_nl(text)))
            else:
                shares.append(Share(lot_id=UUID(lot), amount_ug=parse_mass_ug(text)))
        except UnitError as error:
            drafting.refuse(step, error.code, f"{key}: {error.message}", _CONSUMED, lot=key)
    return tuple(shares)


def _product(step: Step, drafting: Drafting) -> Product | None:
    params, view = step.params, drafting.view
    key, material_id = params["product"], view.materials.get(params["material"])
    found = len(drafting.findings)
    if material_id is None:
        message = f"this lab has no material {params['material']!r}"
        drafting.refuse(step, "plan.no_material", message, "params.material")
    if key in view.lots or key in drafting.products:
        message = f"there is a lot {key!r} already: name the new one otherwise"
        drafting.refuse(step, "crutd.lot_taken", message, "params.product")
    if ("volume" in params) == ("mass" in params):
        message = "say the volume of a liquid product, or the mass of a solid one"
        drafting.refuse(step, "plan.product_amount", message, "params.mass")
    if material_id is None or len(drafting.findings) > found:
        return None
    drafting.products.add(key)
    is_liquid = "volume" in params
    return Product(
        lot_id=uuid5(view.tree.children[None][0].id, f"lot/{key}"),
        material_id=material_id,
        key=key,
        phase=Phase.LIQUID if is_liquid else Phase.SOLID,
        amount_nl=parse_volume_nl(params["volume"]) if is_liquid else 0,
        amount_ug=0 if is_liquid else parse_mass_ug(params["mass"]),
    )


_CONSUMED = "params.consumed"
