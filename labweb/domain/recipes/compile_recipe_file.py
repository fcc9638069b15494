"""A recipe and a rig as bytes: read, bound, compiled, proved; or all that stands against it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from labweb.domain.errors import Finding, ProtocolError
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.proof.prove_plan import prove
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.recipe_to_plan import CompileWish, check_single, compile_recipe
from labweb.domain.recipes.xdl.as_workflow.recipe_to_workflow import to_workflow
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document, refusal
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe
from labweb.domain.recipes.xdl.file_format.xdl_json import parse_json
from labweb.domain.recipes.xdl.file_format.xml_tree import XmlDocument, parse_markup
from labweb.domain.recipes.xdl.lab_choices.chosen_vessels import OnRig
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold


@dataclass(frozen=True, slots=True)
class Proved:
    """A plan that the verifier has carried out on paper."""

    plan: dict[str, Any]
    """As `docs/plan.md` says it."""

    routes: dict[int, tuple[str, ...]]
    """Step → tubes of the graph that its liquid goes through."""


def digest(raw: bytes) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(raw).hexdigest()


def parse_recipe(raw: bytes) -> XmlDocument:
    """Read the markup of a recipe, XML or JSON.

    Raises:
        ProtocolError: It is neither, or more than is read; `findings` say where.
    """
    is_json = raw.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")
    return parse_json(raw) if is_json else parse_markup(raw)


def check_recipe(
    raw: bytes, rig: Rig | None = None, library: Iterable[bytes] = ()
) -> tuple[Recipe, list[Finding]]:
    """Read a recipe as far as it goes, and list everything that is wrong with it.

    Args:
        raw: The file, hostile until read.
        rig: Its vessels may be named without being declared.
        library: Files with blueprints that the recipe uses.

    Raises:
        ProtocolError: It is no markup at all.
    """
    vessels = frozenset[str]() if rig is None else frozenset(Equipment(rig).vessels)
    documents = [parse_recipe(file) for file in library]
    return check_document(parse_recipe(raw), rig_vessels=vessels, library=documents)


def read_recipe(raw: bytes, rig: Rig | None = None, library: Iterable[bytes] = ()) -> Recipe:
    """Read a recipe.

    Raises:
        ProtocolError: Anything is wrong with it; `findings` list all.
    """
    recipe, findings = check_recipe(raw, rig, library)
    if findings:
        raise refusal(findings)
    return recipe


def plan_recipe(recipe: Recipe, rig: Rig, wish: CompileWish, head: Mapping[str, Any]) -> Proved:
    """Compile a recipe and have the plan proved.

    Args:
        recipe: The recipe.
        rig: The rig.
        wish: What is asked beside the recipe.
        head: `recipe` and `graph_sha256` of the plan.

    Raises:
        ProtocolError: The recipe does not say enough; or `plan.not_proved`, with what the
            verifier found: then there is no plan.
        InfeasibleError: The rig cannot do it.

    Effect:
        None.
    """
    made = compile_recipe(recipe, rig, wish)
    plan = {"plan": made["plan"], **head} | made
    proof = prove(plan, rig)
    if proof.findings:
        first = proof.findings[0].message
        message = f"a plan was made and cannot be proved, so it is none: {first}"
        findings = [Finding("plan.not_proved", message), *proof.findings]
        raise ProtocolError(message, code="plan.not_proved", findings=findings)
    return Proved(plan, dict(proof.routes))


def workflow_of(
    recipe: Recipe,
    wish: CompileWish,
    *,
    name: str,
    declared: Declared | None = None,
    rig: OnRig | None = None,
) -> dict[str, Any]:
    """Turn a recipe into the plain data of a workflow; `wish.bind` gives the keys of the lab.

    Args:
        recipe: The recipe.
        wish: What is asked beside the recipe.
        name: What the workflow is called.
        declared: What a person states of lab and matter beside the recipe.
        rig: What a proved plan says of its rig; None: there is none.

    Raises:
        ProtocolError: A workflow cannot say all of it; `findings` list what.
    """
    check_single(recipe)
    acts = unfold(
        recipe,
        parameters=wish.parameters,
        equiv_reference=wish.equiv_reference,
        equiv_amount=wish.equiv_amount,
    )
    return to_workflow(acts, name=name, keys=wish.bind, declared=declared, rig=rig)
