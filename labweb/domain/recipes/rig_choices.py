"""What the workflow of a recipe takes from its rig: its only waste, its stirrers, and no jars.

Where vapour condenses the rig says, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import msgspec

from labweb.domain.graph.rig.model import Rig
from labweb.domain.recipes.on_rig.equipment import Equipment, Sort
from labweb.domain.recipes.recipe_plan import Wish, expand_recipe
from labweb.domain.recipes.xdl.declared import Declared
from labweb.domain.recipes.xdl.expansion.basic import Kind
from labweb.domain.recipes.xdl.expansion.expand import all_operations
from labweb.domain.recipes.xdl.recipe import Recipe


def without_jars(wish: Wish, recipe: Recipe, rig: Rig) -> Wish:
    """Leave out the jars of a lab that a person weighs solids from: no rig has them."""
    operations = list(all_operations(expand_recipe(recipe, wish)))
    solids = {one.fields.get("reagent") for one in operations if one.kind is Kind.ADD_SOLID}
    solids -= {one.fields.get("reagent") for one in operations if one.kind is not Kind.ADD_SOLID}
    known = {element.key for element in rig.elements}
    left = {n: key for n, key in wish.bind.items() if key in known or n not in solids}
    return replace(wish, bind=left)


def unstirred(plan: Mapping[str, Any], rig: Rig) -> set[str]:
    """Return the elements of a rig that a proved plan never stirs."""
    stirred = {
        step["does"].get("vessel") for step in plan["steps"] if step["does"]["kind"] == "stir"
    }
    return {one.key for one in rig.elements} - stirred


def with_receivers(stated: Declared, plan: Mapping[str, Any], equipment: Equipment) -> Declared:
    """Take the flasks that vapour runs into on the rig, where nobody stated others."""
    vessels = plan["bindings"]["vessels"]
    led = {name: equipment.collecting(key) for name, key in vessels.items()}
    known = {name: key for name, key in led.items() if key in equipment.vessels}
    return msgspec.structs.replace(stated, receivers=known | stated.receivers)


def with_waste(stated: Declared, plan: Mapping[str, Any], equipment: Equipment) -> Declared:
    """Take the waste that a proved plan pours into, where nobody stated one and it has but one."""
    if stated.waste:
        return stated
    claims = (step["does"] for step in plan["steps"])
    ends = {does.get(name) for does in claims for name in ("to", "lower_to", "upper_to")}
    wastes = {one for one in ends if one and equipment.vessels.get(one) is Sort.WASTE}
    return msgspec.structs.replace(stated, waste=wastes.pop()) if len(wastes) == 1 else stated
