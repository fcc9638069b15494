"""A recipe with nothing left open: blueprints put in, parameters and equivalents worked out.

What stays is a tree of acts whose vessels and reagents are those of the synthesis. Loops over
reagents or hardware are written out; counted loops and loops that a Monitor ends stay loops, for
only the run can tell how often they go round.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal

from labweb.domain.errors import UnitError
from labweb.domain.recipes.xdl.file_format.attribute_values import (
    ParameterName,
    Value,
    XdlQuantity,
    read_amount,
    read_value,
    written,
)
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.read_xdl import refusal
from labweb.domain.recipes.xdl.file_format.recipe_model import (
    Component,
    Procedure,
    Reagent,
    Recipe,
    XdlParameter,
    XdlStep,
)
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace
from labweb.domain.recipes.xdl.tables.step_spec import STEPS, Property, StepTable
from labweb.domain.recipes.xdl.unfolding.act_order import RecipeAct
from labweb.domain.recipes.xdl.unfolding.amounts_said_twice import without_second_amount
from labweb.domain.recipes.xdl.unfolding.blueprint_names import (
    NameContext,
    Named,
    mapped_reagents,
    mapped_vessels,
    matching,
)
from labweb.domain.recipes.xdl.unfolding.reagent_amounts import (
    Scale,
    has_volume,
    measurable,
    moles_of,
    to_dispense,
)

_MEASURED = {"Add": "reagent", "AddSolid": "reagent", "Dissolve": "solvent"} | {
    "Precipitate": "reagent",
    "Transfer": "",
}
"""Steps with an amount → the property that says of what; "" for a mixture."""

MOST_ACTS = 100_000
"""Most acts that a recipe may unfold to."""


def unfold(
    recipe: Recipe,
    *,
    parameters: Mapping[str, str] | None = None,
    equiv_reference: str = "",
    equiv_amount: str = "",
    table: StepTable = STEPS,
) -> tuple[RecipeAct, ...]:
    """Unfold the synthesis of a recipe.

    Args:
        recipe: With exactly one synthesis, not compiled.
        parameters: Values for its Parameters, before those that the recipe gives.
        equiv_reference: Reagent of which `equiv_amount` is one equivalent.
        equiv_amount: Such as `1 g`; both or none.
        table: The steps the recipe was read with.

    Raises:
        ProtocolError: Something is left open or contradicts itself; `findings` list all.
    """
    told = Findings()
    synthesis = recipe.synthesis
    unfolder = _Unfolder(recipe.blueprints, table, told)
    context = unfolder.top(synthesis, parameters or {})
    context = unfolder.scaled(context, equiv_reference, equiv_amount, synthesis.place)
    acts = unfolder.acts(synthesis.steps, context)
    if told.all:
        raise refusal(told.all)
    return acts


class _Unfolder:
    def __init__(
        self, blueprints: Mapping[str, Procedure], table: StepTable, told: Findings
    ) -> None:
        self._blueprints = blueprints
        self._table = table
        self._told = told
        self._count = 0
        self._top: Procedure | None = None
        """The synthesis itself, whose Parameters are given from outside."""

        self._unread: set[str] = set()
        """Parameters of which the value that was given is told to be none."""

    def top(self, synthesis: Procedure, given: Mapping[str, str]) -> NameContext:
        reagents: dict[str, Named] = {}
        for reagent in synthesis.reagents:
            reagents[reagent.id] = Named(reagent.id, reagent)
        for reagent in synthesis.reagents:
            reagents.setdefault(reagent.name, Named(reagent.id, reagent))
        self._top = synthesis
        known = {p.id for p in synthesis.parameters}
        for name in given:
            if name not in known:
                message = f"the recipe has no Parameter {name!r:.60}"
                self._told.tell("xdl.no_parameter_value", message, synthesis.place, parameter=name)
        return NameContext(
            procedure=synthesis,
            vessels={c.id: c.id for c in synthesis.hardware},
            reagents=reagents,
            parameters={p.id: self._top_parameter(p, given) for p in synthesis.parameters},
            scale=Scale(),
        )

    def _top_parameter(self, parameter: XdlParameter, given: Mapping[str, str]) -> Value | None:
        value = parameter.value
        if parameter.id in given:
            try:
                value = read_value(given[parameter.id], _property_of(parameter))
            except UnitError as error:
                self._unread.add(parameter.id)
                self._told.tell(error.code, error.message, parameter.place, parameter=parameter.id)
        return self._limited(parameter, value, parameter.place)

    def _limited(
        self, parameter: XdlParameter, value: Value | None, place: FilePlace
    ) -> Value | None:
        number, least, most = (
            v.exact if isinstance(v, XdlQuantity) else v
            for v in (value, parameter.least, parameter.most)
        )
        if _is_less(number, least) or _is_less(most, number):
            message = (
                f"{written(value)} for the Parameter {parameter.id!r} is outside of its limits "
                f"{written(parameter.least) or 'any'} to {written(parameter.most) or 'any'}"
            )
            self._told.tell("xdl.parameter_limit", message, place, parameter=parameter.id)
        return value

    def scaled(
        self, context: NameContext, reference: str, amount: str, place: FilePlace
    ) -> NameContext:
        if not reference and not amount:
            return context
        if not reference or not amount:
            message = "equiv_reference and equiv_amount are given both, or neither"
            self._told.tell("xdl.equivalents_incomplete", message, place)
            return context
        named = context.reagents.get(reference)
        if named is None:
            message = f"the equivalents are counted by {reference!r}, which is no reagent here"
            self._told.tell("xdl.equivalents_reference", message, place)
            return context
        try:
            moles = moles_of(read_amount(amount), named.facts)
        except UnitError as error:
            self._told.tell(error.code, f"equiv_amount: {error.message}", place)
            return context
        return replace(context, scale=replace(context.scale, moles=moles))

    def acts(self, steps: tuple[XdlStep, ...], context: NameContext) -> tuple[RecipeAct, ...]:
        return tuple(self._act(step, context) for step in steps)

    def _act(self, step: XdlStep, context: NameContext) -> RecipeAct:
        self._count += 1
        if self._count > MOST_ACTS:
            message = f"the recipe unfolds to more than {MOST_ACTS} steps"
            self._told.tell("xdl.too_many", message, step.place)
            raise refusal(self._told.all)
        if step.name in self._blueprints and self._table.spec(step.name) is None:
            return self._use(step, context)
        spec = self._table.spec(step.name)
        values = {
            name: value
            for name, raw in step.values.items()
            if (value := self._value(step, name, raw, context)) is not None
        }
        return RecipeAct(
            name=step.name,
            values=self._measured(step, values, context),
            children=self._rounds(step, context)
            if step.loop
            else self.acts(step.children, context),
            is_monitor=spec is not None and spec.is_monitor,
            queue=step.queue,
            section=step.section,
            place=step.place,
        )

    def _value(self, step: XdlStep, name: str, raw: Value, context: NameContext) -> Value | None:
        if isinstance(raw, ParameterName):
            found = context.parameters.get(raw.id)
            if found is None:
                message = f"{name} of {step.name}: the Parameter {raw.id!r} has no value"
                is_given_here = context.procedure is self._top
                facts = {"parameter": raw.id} if is_given_here else {}
                if not (is_given_here and raw.id in self._unread):
                    self._told.tell("xdl.no_parameter_value", message, step.place, **facts)
            return found
        spec = self._table.spec(step.name)
        wanted = spec.properties.get(name) if spec is not None else None
        if wanted is None or not isinstance(raw, str):
            return raw
        if wanted.sort == "vessel":
            flask = context.reagents.get(raw)
            return context.vessels.get(raw, flask.name if flask else raw)
        if wanted.sort == "reagent":
            named = context.reagents.get(raw)
            return named.name if named else raw
        if wanted.sort == "through":
            return context.vessels.get(raw, raw)
        return raw

    def _measured(
        self, step: XdlStep, values: dict[str, Value], context: NameContext
    ) -> dict[str, Value]:
        of = _MEASURED.get(step.name)
        names = ("amount", "volume", "mass", "mol")
        given = [name for name in names if isinstance(values.get(name), XdlQuantity)]
        if of is None or not given:
            return values
        amount = values[given[0]]
        raw = step.values.get(of)
        named = context.reagents.get(raw) if isinstance(raw, str) else None
        if not isinstance(amount, XdlQuantity) or (of and named is None):
            return values
        facts = named.facts if named else None
        if given[0] == "volume" or (given[0] == "mass" and not _is_dense_liquid(step, facts)):
            # A volume is what is dispensed, whatever else is known; a mass is weighed in, unless
            # it is that of a liquid of known density.
            return without_second_amount(step.name, values, facts, step.place, self._told)
        if facts is not None and (step.name == "AddSolid" or _is_weighed(step, amount, facts)):
            facts = replace(facts, values={**facts.values, "solid": True})
        try:
            dispensed = to_dispense(amount, facts, context.scale)
        except UnitError as error:
            self._told.tell(error.code, f"{step.name}: {error.message}", step.place)
            return values
        if (dispensed.sort, dispensed.exact) != (amount.sort, amount.exact):
            dispensed = measurable(dispensed)
        # What was measured out stands for what it was worked out of.
        kept = {name: v for name, v in values.items() if name not in ("mass", "mol")}
        return {**kept, dispensed.sort: dispensed}

    def _rounds(self, step: XdlStep, context: NameContext) -> tuple[RecipeAct, ...]:
        variables: dict[str, list[tuple[str, str]]] = {}
        for variable, attribute, value in step.loop:
            variables.setdefault(variable, []).append((attribute, value))
        runs = {v: matching(clauses, context.procedure) for v, clauses in variables.items()}
        for variable, found in runs.items():
            if not found:
                message = f"nothing that is declared matches the loop variable {variable!r}"
                self._told.tell("xdl.loop_matches_nothing", message, step.place)
        acts: list[RecipeAct] = []
        for round_ in zip(*runs.values(), strict=False):
            vessels, reagents = dict(context.vessels), dict(context.reagents)
            for variable, entry in zip(runs, round_, strict=True):
                if isinstance(entry, Component):
                    vessels[variable] = context.vessels.get(entry.id, entry.id)
                else:
                    reagents[variable] = context.reagents[entry.id]
            acts += self.acts(step.children, replace(context, vessels=vessels, reagents=reagents))
        return tuple(acts)

    def _use(self, step: XdlStep, context: NameContext) -> RecipeAct:
        blueprint = self._blueprints[step.name]
        inner = NameContext(
            procedure=blueprint,
            vessels=mapped_vessels(blueprint, step.mapping, context),
            reagents=mapped_reagents(blueprint, step.mapping, context),
            parameters={
                p.id: self._mapped_parameter(p, step, context) for p in blueprint.parameters
            },
            scale=Scale(context.scale.moles, _base(blueprint)),
        )
        reference, amount = step.values.get("equiv_reference"), step.values.get("equiv_amount")
        if (reference is None) != (amount is None):
            message = "equiv_reference and equiv_amount are given both, or neither"
            self._told.tell("xdl.equivalents_incomplete", message, step.place)
        elif isinstance(reference, str) and isinstance(amount, XdlQuantity):
            inner = self._scaled_by(inner, reference, amount, step.place)
        return RecipeAct(
            name=blueprint.id,
            children=self.acts(blueprint.steps, inner),
            is_blueprint=True,
            queue=step.queue,
            section=step.section,
            place=step.place,
        )

    def _scaled_by(
        self, context: NameContext, reference: str, amount: XdlQuantity, place: FilePlace
    ) -> NameContext:
        named = context.reagents.get(reference)
        if named is None:
            message = f"the equivalents are counted by {reference!r}, which is no reagent here"
            self._told.tell("xdl.equivalents_reference", message, place)
            return context
        try:
            moles = moles_of(amount, named.facts)
        except UnitError as error:
            self._told.tell(error.code, f"equiv_amount: {error.message}", place)
            return context
        return replace(context, scale=replace(context.scale, moles=moles))

    def _mapped_parameter(
        self, parameter: XdlParameter, step: XdlStep, context: NameContext
    ) -> Value | None:
        text = step.mapping.get(parameter.id)
        if text is None:
            return self._limited(parameter, parameter.value, step.place)
        if text in context.parameters:
            value = context.parameters[text]
            if value is None:
                message = f"the Parameter {text!r} has no value"
                self._told.tell("xdl.no_parameter_value", message, step.place)
        else:
            try:
                value = read_value(text, _property_of(parameter))
            except UnitError as error:
                self._told.tell(error.code, error.message, step.place)
                return None
        return self._limited(parameter, value, step.place)


def _is_dense_liquid(step: XdlStep, facts: Reagent | None) -> bool:
    known = facts is not None and not facts.is_solid and "density" in facts.values
    return known and step.name == "Add"


def _is_weighed(step: XdlStep, amount: XdlQuantity, facts: Reagent) -> bool:
    """Tell whether an amount is a mass of what nobody can measure by its volume."""
    return step.name == "Add" and amount.sort == "mass" and not has_volume(facts)


def _property_of(parameter: XdlParameter) -> Property:
    return Property(name=parameter.id, sort=parameter.sort)


def _base(blueprint: Procedure) -> Decimal | None:
    scale = blueprint.base_scale
    return scale.exact if isinstance(scale, XdlQuantity) else None


def _is_less(one: object, other: object) -> bool:
    if one is None or other is None or isinstance(one, str | bool) or isinstance(other, str | bool):
        return False
    return bool(one < other)  # type: ignore[operator]
