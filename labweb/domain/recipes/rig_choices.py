"""What the workflow of a recipe takes from its rig: stirrers, condensers, fillings, and no jars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import msgspec

from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.recipe_to_plan import CompileWish, expand_recipe
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicKind
from labweb.domain.recipes.xdl.expansion.expand import all_operations
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe
from labweb.domain.recipes.xdl.lab_choices.chosen_vessels import OnRig
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared


def without_jars(wish: CompileWish, recipe: Recipe, rig: Rig) -> CompileWish:
    """Leave out the jars of a lab that a person weighs solids from: no rig has them."""
    operations = list(all_operations(expand_recipe(recipe, wish)))
    solids = {one.fields.get("reagent") for one in operations if one.kind is BasicKind.ADD_SOLID}
    solids -= {
        one.fields.get("reagent") for one in operations if one.kind is not BasicKind.ADD_SOLID
    }
    known = {element.key for element in rig.elements}
    left = {n: key for n, key in wish.bind.items() if key in known or n not in solids}
    return replace(wish, bind=left)


def on_rig(plan: Mapping[str, Any], rig: Rig) -> OnRig:
    """Return what a proved plan says of its rig: what is never stirred, and what was chosen."""
    stirred = {
        step["does"].get("vessel") for step in plan["steps"] if step["does"]["kind"] == "stir"
    }
    unstirred = frozenset({one.key for one in rig.elements} - stirred)
    return OnRig(unstirred, tuple(plan["bindings"].get("chosen", ())))


def with_receivers(stated: Declared, plan: Mapping[str, Any], equipment: Equipment) -> Declared:
    """Take the flasks that vapour runs into on the rig, where nobody stated others."""
    vessels = plan["bindings"]["vessels"]
    led = {name: equipment.collecting(key) for name, key in vessels.items()}
    known = {name: key for name, key in led.items() if key in equipment.vessels}
    return msgspec.structs.replace(stated, receivers=known | stated.receivers)


def with_fillings(wish: CompileWish, recipe: Recipe, equipment: Equipment) -> CompileWish:
    """Bind what a recipe calls a cartridge by its filling to the only cartridge that has it."""
    operations = all_operations(expand_recipe(recipe, wish))
    names = {"through", "lower_through", "upper_through"}
    said = {str(value) for one in operations for n, value in one.fields.items() if n in names}
    bound = dict(wish.bind)
    for name in said - equipment.elements.keys() - bound.keys():
        having = [key for key, filling in equipment.cartridges.items() if filling == name]
        if len(having) == 1:
            bound[name] = having[0]
    return replace(wish, bind=bound)
