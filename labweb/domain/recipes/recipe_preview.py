"""A recipe opened on a rig, for a person to see: what is bound, what is planned, what is wrong.

Everything is plain data. What cannot be planned still says as much as is known: the graph, what the
recipe declares, and which of the graph's vessels each of it could be.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from labweb.domain.clock_and_ids import Clock
from labweb.domain.errors import Finding, LabError, UnitError
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.rig_read import read_rig, unpacked
from labweb.domain.recipes.advise.fewest_changes import Advice, advise
from labweb.domain.recipes.agreement.proved import sources_of, vessels_of
from labweb.domain.recipes.compile_recipe_file import (
    Proved,
    check_recipe,
    digest,
    plan_recipe,
    read_recipe,
)
from labweb.domain.recipes.on_rig.binding import RigBinding, bind, may_be
from labweb.domain.recipes.on_rig.equipment import Equipment, VesselSort
from labweb.domain.recipes.on_rig.labels import alike
from labweb.domain.recipes.recipe_to_plan import CompileWish, expand_recipe
from labweb.domain.recipes.rig_choices import without_jars
from labweb.domain.recipes.workflow_on_rig import document_of, workflow_on_rig
from labweb.domain.recipes.xdl.expansion.expand import all_operations
from labweb.domain.recipes.xdl.file_format.attribute_values import unit_of, written
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.recipe_model import Procedure, Recipe
from labweb.domain.recipes.xdl.lab_choices.declarations_file import (
    Declared,
    bindings,
    read_declared,
)
from labweb.domain.units import parse_volume_nl

_NL_PER_UL = 1000
_UNPROVED = "plan.not_proved"
_STATED = "xdl.not_declared"
_WISHED = frozenset(
    {"xdl.no_equivalents", "xdl.equivalents_incomplete", "xdl.equivalents_reference"}
)
"""Findings about what whoever opens a recipe says, beside those of a Parameter of theirs."""


@dataclass(frozen=True, kw_only=True)
class PreviewAsked:
    """What whoever opens a recipe says."""

    name: str
    """The file's, without its ending; it becomes the id of the recipe in the plan."""

    recipe: bytes
    graph: bytes = b""
    """Empty: the recipe is read without a rig."""

    is_of_lab: bool = False
    """The graph is that of the lab, in which the recipe would run: it becomes a workflow, too."""

    bind: Mapping[str, str] = field(default_factory=dict)
    holds: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Vessel of the graph → reagent → volume with its unit, as a person writes it."""

    blueprints: tuple[bytes, ...] = ()
    """Files with blueprints that the recipe uses."""

    declared: bytes = b""
    """What is stated beside the recipe, `labweb.declared/1`; empty: nothing."""

    rinse: tuple[str, ...] = ()
    """What lines are rinsed with, in this order; without any, what the recipe cleans with."""

    primes: bool = False
    """Tubes that say what they hold are filled before, and pushed out after."""

    parameters: Mapping[str, str] = field(default_factory=dict)
    equiv_reference: str = ""
    equiv_amount: str = ""

    def stated(self) -> Declared | None:
        """Return what is stated beside the recipe.

        Raises:
            ProtocolError: `xdl.not_declared`, when the file is none.
        """
        return read_declared(self.declared) if self.declared else None

    def wish(self, recipe: Recipe, stated: Declared | None) -> CompileWish:
        """Return it for the compiler; what is bound by hand wins over what is stated.

        Raises:
            UnitError: What a vessel holds is no volume; `findings` list each.
        """
        keys = {} if stated is None else bindings(stated, recipe)
        holds, wrong = self._held_nl()
        if wrong:
            first = wrong[0]
            raise UnitError(first.message, code=first.code, findings=wrong)
        return CompileWish(
            bind={**keys, **self.bind},
            holds_nl=holds,
            rinse=self.rinse,
            primes=self.primes,
            groups={} if stated is None else stated.groups,
            parameters=dict(self.parameters),
            equiv_reference=self.equiv_reference,
            equiv_amount=self.equiv_amount,
        )

    def head(self, graph_sha256: str) -> dict[str, Any]:
        """Return what a plan says of the files that it is made of."""
        recipe = {"id": self.name, "sha256": digest(self.recipe)}
        return {"recipe": recipe, "graph_sha256": graph_sha256}

    def _held_nl(self) -> tuple[dict[str, dict[str, int]], list[Finding]]:
        found: dict[str, dict[str, int]] = {}
        wrong = []
        for vessel, held in self.holds.items():
            for reagent, text in held.items():
                try:
                    found.setdefault(vessel, {})[reagent] = parse_volume_nl(text)
                except UnitError as error:
                    facts = {"vessel": vessel, "reagent": reagent}
                    wrong.append(Finding(error.code, error.message, vessel, facts))
        return found, wrong


def open_recipe(asked: PreviewAsked) -> dict[str, Any]:
    """Read, bind, compile and prove; what is wrong is part of the answer.

    Returns:
        `recipe`, `rig`, `bindings`, `findings`, and `plan`, which is None unless the verifier has
        proved it. Each step of the plan has its `route`: the tubes that its liquid goes through.
        `document` is the workflow that does the same, its vessels as `@key`; None: it is not
        asked for, or findings about `workflow` say why there is none.

    Effect:
        None.
    """
    answer: dict[str, Any] = {
        "recipe": None,
        "rig": None,
        "bindings": [],
        "findings": [],
        "plan": None,
        "is_proved": None,
        "document": None,
    }
    rig, recipe = _rig(asked, answer), None
    findings: list[Finding] = []
    try:
        recipe, findings = check_recipe(asked.recipe, rig, asked.blueprints)
        answer["recipe"] = _recipe(recipe, asked)
    except LabError as error:
        _tell(answer, "recipe", error)
    answer["findings"] += _plain("recipe", findings)
    stated = _stated(asked, answer)
    if recipe is None or rig is None or len(recipe.syntheses) != 1:
        return answer
    is_open = not findings and (stated is not None or not asked.declared)
    binding = None
    try:
        wish = asked.wish(recipe, stated)
        wish = without_jars(wish, recipe, rig) if is_open else wish
        binding = _bound(recipe, rig, wish) if is_open else None
        if is_open:
            proved = plan_recipe(recipe, rig, wish, asked.head(answer["rig"]["sha256"]))
            answer["plan"], answer["is_proved"] = _planned(proved), True
    except LabError as error:
        answer["is_proved"] = False if error.code == _UNPROVED else None
        _tell(answer, "rig", error)
    answer["bindings"] = _bindings(recipe.synthesis, rig, asked, binding)
    if asked.is_of_lab and answer["plan"] is not None:
        _draw(answer, asked, recipe, rig, stated)
    keys = {} if stated is None else stated.keys
    for row in answer["bindings"]:
        row["is_stated"] = row["role"] in keys and not row["is_by_hand"]
    return answer


def _draw(
    answer: dict[str, Any], asked: PreviewAsked, recipe: Recipe, rig: Rig, stated: Declared | None
) -> None:
    """Add the workflow that a proved plan becomes, or why it becomes none."""
    rows = answer["bindings"]
    if any(len(row["keys"]) > 1 for row in rows):
        return  # A workflow takes each reagent from one vessel: which, a person chooses first.
    bound = {row["role"]: row["keys"][0] for row in rows if len(row["keys"]) == 1}
    try:
        wish = asked.wish(recipe, stated)
        wish = replace(wish, bind={**bound, **wish.bind})
        answer["document"] = document_of(recipe, rig, wish, stated, answer["plan"])
    except LabError as error:
        _tell(answer, "workflow", error)


def advise_on(asked: PreviewAsked, clock: Clock | None = None) -> dict[str, Any]:
    """Return what to change in the graph so that the recipe compiles and is proved, or why not.

    Args:
        asked: The recipe and the graph.
        clock: Ends the search, as `advise` says.

    Raises:
        LabError: Recipe or graph cannot be read.
    """
    rig = read_rig(unpacked(asked.graph))
    recipe = read_recipe(asked.recipe, rig, asked.blueprints)
    wish = without_jars(asked.wish(recipe, asked.stated()), recipe, rig)
    found = advise(recipe, rig, wish, clock)
    if isinstance(found, Advice):
        return found.to_json() | {"graph": found.graph.decode()}
    return {"ok": False, "findings": [finding.to_json() for finding in found]}


def workflow_from(asked: PreviewAsked) -> dict[str, Any]:
    """Return the document of a workflow that does what the plan of a recipe is proved to do.

    Returns:
        `document`, and `proved`: `recipe_sha256`, `graph_sha256`, `sources`, the vessels that
        reagents come out of, by key, and `vessels`, the keys of the others that the plan binds.

    Raises:
        LabError: It cannot be read, there is no proved plan, a workflow cannot say all of it, or
            `recipe.differs`, with each deed that the two do not have in common.
    """
    raw = unpacked(asked.graph)
    rig, stated = read_rig(raw), asked.stated()
    recipe = read_recipe(asked.recipe, rig, asked.blueprints)
    wish, head = asked.wish(recipe, stated), asked.head(digest(raw))
    plan, document = workflow_on_rig(recipe, rig, wish, stated, head)
    proved = {
        "recipe_sha256": head["recipe"]["sha256"],
        "graph_sha256": head["graph_sha256"],
        "sources": sources_of(plan),
        "vessels": vessels_of(plan),
    }
    return {"document": document, "proved": proved}


def _stated(asked: PreviewAsked, answer: dict[str, Any]) -> Declared | None:
    try:
        return asked.stated()
    except LabError as error:
        _tell(answer, "declared", error)
        return None


def _rig(asked: PreviewAsked, answer: dict[str, Any]) -> Rig | None:
    if not asked.graph:
        return None
    try:
        raw = unpacked(asked.graph)
        rig = read_rig(raw)
    except LabError as error:
        _tell(answer, "graph", error)
        return None
    equipment = Equipment(rig)
    answer["rig"] = {
        "format": rig.format.value,
        "sha256": digest(raw),
        "nodes": [
            {
                "key": element.key,
                "kind": element.kind,
                "role": element.role.value,
                "sort": equipment.vessels.get(element.key),
                "chemical": equipment.chemical(element.key),
                "holds": _held(equipment, element.key),
            }
            for element in rig.elements
        ],
        "tubes": [
            {
                "key": tube.key,
                "source": tube.source,
                "source_port": tube.source_port,
                "target": tube.target,
                "target_port": tube.target_port,
                "medium": tube.medium.value,
            }
            for tube in rig.tubes
        ],
        "defects": [defect.to_json() for defect in rig.defects],
    }
    return rig


def _held(equipment: Equipment, key: str) -> list[dict[str, Any]]:
    """Return what the graph says is in a vessel, in µL."""
    if key not in equipment.vessels:
        return []
    found = equipment.contents(key)
    return [{"name": name, "volume_ul": nl / _NL_PER_UL} for name, nl in found]


def _recipe(recipe: Recipe, asked: PreviewAsked) -> dict[str, Any]:
    single = recipe.syntheses[0] if len(recipe.syntheses) == 1 else None
    parameters = () if single is None else single.parameters
    return {
        "name": asked.name,
        "version": recipe.version,
        "sha256": digest(asked.recipe),
        "is_compiled": recipe.is_compiled,
        "syntheses_count": len(recipe.syntheses),
        "steps_count": 0 if single is None else len(single.steps),
        "parameters": [
            {
                "id": one.id,
                "sort": one.sort,
                "unit": unit_of(one.sort),
                "value": written(one.value),
                "least": written(one.least),
                "most": written(one.most),
            }
            for one in parameters
        ],
        "cleans_with": []
        if single is None
        else [one.id for one in single.reagents if one.values.get("use_for_cleaning") is True],
    }


def _bound(recipe: Recipe, rig: Rig, wish: CompileWish) -> RigBinding:
    operations = all_operations(expand_recipe(recipe, wish))
    return bind(recipe.synthesis, operations, Equipment(rig), wish.bind, Findings(), wish.rinse)


def _bindings(
    procedure: Procedure, rig: Rig, asked: PreviewAsked, binding: RigBinding | None
) -> list[dict[str, Any]]:
    """List what the recipe declares: what it is here, and what else it may be."""
    equipment = Equipment(rig)
    vessels = {} if binding is None else binding.vessels
    reagents = {} if binding is None else binding.reagents
    rows = []
    for one in procedure.hardware:
        choices = [key for key, sort in equipment.vessels.items() if may_be(one, sort)]
        keys = [vessels[one.id]] if one.id in vessels else []
        rows.append(_row(one.id, "vessel", one.type, keys, choices, asked))
    flasks = [
        k for k, sort in equipment.vessels.items() if sort in (VesselSort.FLASK, VesselSort.PLAIN)
    ]
    for reagent in procedure.reagents:
        if reagent.is_solid and reagent.id not in reagents:
            continue
        told = "" if reagent.name == reagent.id else reagent.name
        keys = list(reagents.get(reagent.id, ()))
        row = _row(reagent.id, "reagent", told, keys, flasks, asked)
        near = {} if keys else alike(reagent.id, equipment)
        is_it = bool({reagent.id, reagent.name} & set(near.values()))
        rows.append(row | {"alike": [] if is_it else list(near)})
    return rows


def _row(
    role: str, what: str, told: str, keys: list[str], choices: list[str], asked: PreviewAsked
) -> dict[str, Any]:
    return {
        "role": role,
        "what": what,
        "told": told,
        "keys": keys,
        "choices": choices,
        "alike": [],
        "is_by_hand": role in asked.bind,
    }


def _planned(proved: Proved) -> dict[str, Any]:
    steps = [step | {"route": proved.routes.get(step["id"], ())} for step in proved.plan["steps"]]
    return proved.plan | {"steps": steps}


def _tell(answer: dict[str, Any], about: str, error: LabError) -> None:
    findings = error.findings or (Finding(error.code, error.message),)
    about = "wish" if isinstance(error, UnitError) else about
    for finding in findings:
        is_wish = finding.code in _WISHED or "parameter" in finding.context
        told = "declared" if finding.code == _STATED else "wish" if is_wish else about
        answer["findings"] += _plain(told, [finding])


def _plain(about: str, findings: Iterable[Finding]) -> list[dict[str, Any]]:
    return [finding.to_json() | {"about": about} for finding in findings]
