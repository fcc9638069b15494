"""A recipe on a rig as the workflow that does what its plan is proved to do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.recipes.agreement.check import check_same
from labweb.domain.recipes.agreement.weaving import weave_rinses
from labweb.domain.recipes.compile_recipe_file import plan_recipe, workflow_of
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.recipe_to_plan import CompileWish
from labweb.domain.recipes.rig_choices import (
    on_rig,
    with_fillings,
    with_receivers,
    without_jars,
)
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared


def workflow_on_rig(
    recipe: Recipe, rig: Rig, wish: CompileWish, stated: Declared | None, head: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the proved plan of a recipe, and the workflow that does the same.

    Args:
        recipe: The recipe.
        rig: The rig.
        wish: What is asked beside the recipe, names bound to keys of the rig.
        stated: What a person states of lab and matter; None: nothing.
        head: `recipe` and `graph_sha256` of the plan.

    Raises:
        LabError: There is no proved plan, a workflow cannot say all of it, or `recipe.differs`,
            with each deed that the two do not have in common.
    """
    plan = plan_recipe(recipe, rig, without_jars(wish, recipe, rig), head).plan
    return plan, document_of(recipe, rig, wish, stated, plan)


def document_of(
    recipe: Recipe, rig: Rig, wish: CompileWish, stated: Declared | None, plan: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the workflow that does what a proved plan of a recipe does.

    Args:
        recipe: The recipe.
        rig: The rig.
        wish: What is asked beside the recipe, names bound to keys of the rig.
        stated: What a person states of lab and matter; None: nothing.
        plan: As `docs/plan.md` says it, proved on this rig.

    Raises:
        LabError: A workflow cannot say all of it, or `recipe.differs`, with each deed that the
            two do not have in common.
    """
    equipment = Equipment(rig)
    document = workflow_of(
        recipe,
        with_fillings(wish, recipe, equipment),
        name=plan["recipe"]["id"][:200],
        declared=with_receivers(stated or Declared(), plan, equipment),
        rig=on_rig(plan, rig),
    )
    document = weave_rinses(plan, document)
    check_same(plan, document, rig.pumps)
    return document
