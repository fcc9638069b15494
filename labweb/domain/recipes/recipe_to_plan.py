"""From a recipe to the plan of one rig: what each device does, in which order, or why not."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from labweb.domain.errors import Finding, InfeasibleError, ProtocolError
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.stated_volumes import check_volumes
from labweb.domain.recipes.on_rig import rinsing
from labweb.domain.recipes.on_rig.binding import RigBinding, bind
from labweb.domain.recipes.on_rig.charging import charge, check_charge
from labweb.domain.recipes.on_rig.chemistry import read_chemistry
from labweb.domain.recipes.on_rig.equipment import Equipment, VesselSort
from labweb.domain.recipes.on_rig.making import BESIDE, BY_HAND, Making
from labweb.domain.recipes.on_rig.matter import micro, plain
from labweb.domain.recipes.on_rig.meetings import Meetings
from labweb.domain.recipes.on_rig.moving import fill
from labweb.domain.recipes.on_rig.reagents import check_reagents, say_unheeded
from labweb.domain.recipes.on_rig.safety import shut_down
from labweb.domain.recipes.on_rig.scheduling import (
    check_duration,
    critical_path_s,
    earlier_steps,
)
from labweb.domain.recipes.on_rig.stated import check_nodes
from labweb.domain.recipes.on_rig.steps import (
    conditions,
    gases,
    instruments,
    liquids,
    parting,
    rounds,
)
from labweb.domain.recipes.xdl.expansion.act_reading import default_number
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicKind, BasicOperation
from labweb.domain.recipes.xdl.expansion.expand import Expansion, all_operations, expand
from labweb.domain.recipes.xdl.expansion.unread_properties import Heeded
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.recipe_model import Procedure, Recipe
from labweb.domain.recipes.xdl.file_format.xml_tree import NOWHERE
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold

VERSION = 1
MOST_STEPS = 100_000
"""Most steps that a plan has."""
_MOST_DEFECTS = 8
_MOST_ROUNDS = "repeat.most_rounds"

_HANDLERS: Mapping[BasicKind, Callable[[Making, BasicOperation], None]] = {
    BasicKind.ADD_LIQUID: liquids.add_liquid,
    BasicKind.ADD_SOLID: liquids.add_solid,
    BasicKind.TRANSFER: liquids.transfer,
    BasicKind.SEPARATE_PHASES: parting.separate_phases,
    BasicKind.DRAW_FILTRATE: parting.draw_filtrate,
    BasicKind.RUN_COLUMN: liquids.transfer,
    BasicKind.RINSE_LINES: rinsing.rinse_lines,
    BasicKind.FLUSH_LINES: rinsing.flush_lines,
    BasicKind.START_STIR: conditions.start_stir,
    BasicKind.STOP_STIR: conditions.stop_stir,
    BasicKind.SET_TEMPERATURE: conditions.set_temperature,
    BasicKind.AWAIT_TEMPERATURE: conditions.await_temperature,
    BasicKind.STOP_TEMPERATURE: conditions.stop_temperature,
    BasicKind.WAIT: conditions.wait,
    BasicKind.START_VACUUM: gases.start_vacuum,
    BasicKind.STOP_VACUUM: gases.stop_vacuum,
    BasicKind.START_GAS: gases.start_gas,
    BasicKind.STOP_GAS: gases.stop_gas,
    BasicKind.START_ROTATION: conditions.start_rotation,
    BasicKind.STOP_ROTATION: conditions.stop_rotation,
    BasicKind.LOWER_FLASK: conditions.lower_flask,
    BasicKind.RAISE_FLASK: conditions.raise_flask,
    BasicKind.EVAPORATE: conditions.evaporate,
    BasicKind.START_LIGHT: conditions.start_light,
    BasicKind.STOP_LIGHT: conditions.stop_light,
    BasicKind.MEASURE: conditions.measure,
    BasicKind.START_ULTRASOUND: instruments.start_ultrasound,
    BasicKind.STOP_ULTRASOUND: instruments.stop_ultrasound,
    BasicKind.MICROWAVE: instruments.microwave,
    BasicKind.SPIN: instruments.spin,
    BasicKind.COLLECT_DISTILLATE: instruments.distill,
    BasicKind.ADJUST: rounds.adjust,
    BasicKind.ASK: conditions.ask,
    BasicKind.AWAIT: conditions.await_lane,
}


@dataclass(frozen=True, kw_only=True)
class CompileWish:
    """What whoever compiles a recipe says beside the recipe."""

    bind: Mapping[str, str] = field(default_factory=dict)
    """Vessel or reagent of the recipe → id of the graph."""

    holds_nl: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    """Vessel of the graph → reagent → what is in it before the first step."""

    rinse: tuple[str, ...] = ()
    """Reagents that rinse the lines; without any, those that the recipe cleans with."""

    primes: bool = False
    """Tubes that say what they hold are filled before, and pushed out after."""

    groups: Mapping[str, Collection[str]] = field(default_factory=dict)
    """Reagent → groups of substances that it belongs to, as a person states them."""

    parameters: Mapping[str, str] = field(default_factory=dict)
    equiv_reference: str = ""
    equiv_amount: str = ""


def compile_recipe(recipe: Recipe, rig: Rig, wish: CompileWish | None = None) -> dict[str, Any]:
    """Plan the synthesis of a recipe on a rig.

    Every volume is followed from its flask on, so that a plan that is returned runs no vessel dry
    or over, as far as anybody can know before the run.

    Returns:
        The plan as `docs/plan.md` says it, without the ids and hashes of files.

    Raises:
        ProtocolError: The recipe itself does not say enough.
        InfeasibleError: The rig cannot do it. Either carries all findings.

    Effect:
        None.
    """
    asked = wish or CompileWish()
    expanded = expand_recipe(recipe, asked)
    equipment, told = Equipment(rig), Findings()
    operations = tuple(all_operations(expanded))
    binding = bind(recipe.synthesis, operations, equipment, asked.bind, told, asked.rinse)
    rinses = _rinses(recipe.synthesis, binding, asked)
    told.all += [*check_volumes(rig), *check_nodes(equipment)]
    told.all += check_charge(equipment, binding, asked.holds_nl)
    reagents = recipe.synthesis.reagents
    check_reagents(reagents, operations, told)
    chemistry, strange = read_chemistry(
        equipment, reagents, binding.reagents, asked.groups, asked.holds_nl
    )
    told.all += strange
    begin = partial(
        Making,
        equipment=equipment,
        binding=binding,
        rinses=rinses,
        chemistry=chemistry,
        primes=asked.primes,
        leftovers=_leftovers(equipment, binding),
        roles={reagent.id: str(reagent.values.get("role")) for reagent in reagents},
    )
    apart = partial(Meetings, chemistry.pairs(), _kept_apart(equipment, binding))
    counting = begin(told=Findings(), meetings=apart())
    _make(counting, expanded, asked)
    while new := counting.met_traces - counting.unwelcome:
        begin = partial(begin, unwelcome=counting.unwelcome | new)
        counting = begin(told=Findings(), meetings=apart())
        _make(counting, expanded, asked)
    making = begin(told=told, needed_nl=dict(counting.taken_nl), meetings=apart())
    contents = _make(making, expanded, asked)
    check_duration(making.steps, told)
    if told.all:
        raise _infeasible([*told.all, *rig.defects[:_MOST_DEFECTS]])
    for defect in rig.defects:
        making.note(defect.message)
    unheeded = say_unheeded(recipe.synthesis, operations)
    for text in (*binding.notes, *unheeded, *_undriven(making)):
        making.note(text)
    return _render(making, contents)


def _kept_apart(equipment: Equipment, binding: RigBinding) -> set[str]:
    """Return the vessels in which liquids meet that the recipe never brought together."""
    wastes = {key for key, sort in equipment.vessels.items() if sort is VesselSort.WASTE}
    drained = {equipment.collecting(key) or "" for key in equipment.vessels}
    return wastes | (drained - {"", *binding.vessels.values()})


def _leftovers(equipment: Equipment, binding: RigBinding) -> frozenset[str]:
    """Return what the graph says is in vessels, and is no reagent of the recipe."""
    keys = equipment.vessels.keys() - binding.flasks()
    named = frozenset(name for key in keys for name, _ in equipment.contents(key))
    return named - binding.reagents.keys()


def _undriven(making: Making) -> list[str]:
    """Say which devices of a lab of ours a plan uses and no driver drives."""
    used = {command["device"] for step in making.steps for g in step.actions for command in g}
    elements = (making.equipment.elements.get(key) for key in sorted(used))
    return [
        f"no driver drives {one.key}: before such a plan is run, a device is bound to it"
        for one in elements
        if one is not None and one.attributes.get("is_driven") is False
    ]


def check_single(recipe: Recipe) -> None:
    """Refuse a file that is no single recipe.

    Raises:
        ProtocolError: It is compiled already, or holds several syntheses, or none.
    """
    if recipe.is_compiled or len(recipe.syntheses) != 1:
        what = "is compiled already" if recipe.is_compiled else "holds not exactly one synthesis"
        raise ProtocolError(f"the file {what}", code="plan.no_recipe")


def expand_recipe(recipe: Recipe, wish: CompileWish) -> tuple[Expansion, ...]:
    """Return the basic operations of a recipe, still without a rig.

    Raises:
        ProtocolError: The recipe does not say enough; `findings` list what is missing.
    """
    check_single(recipe)
    acts = unfold(
        recipe,
        parameters=wish.parameters,
        equiv_reference=wish.equiv_reference,
        equiv_amount=wish.equiv_amount,
    )
    return expand(acts)


def _infeasible(findings: Iterable[Finding]) -> InfeasibleError:
    unique = list({(f.code, f.message, f.subject): f for f in findings}.values())
    more = f" (and {len(unique) - 1} more)" if len(unique) > 1 else ""
    first = unique[0]
    return InfeasibleError(first.message + more, code=first.code, findings=unique)


def _rinses(procedure: Procedure, binding: RigBinding, wish: CompileWish) -> tuple[str, ...]:
    if wish.rinse:
        return tuple(name for name in wish.rinse if name in binding.reagents)
    return tuple(
        reagent.id
        for reagent in procedure.reagents
        if reagent.values.get("use_for_cleaning") is True and reagent.id in binding.reagents
    )


def _make(
    making: Making, expanded: tuple[Expansion, ...], wish: CompileWish
) -> dict[str, list[dict[str, str | float]]]:
    """Make all steps; return what was in the vessels before the first."""
    charge(making, wish.holds_nl)
    contents = {
        key: plain(making.matter.held(key))
        for key in making.equipment.vessels
        if making.matter.held(key)
    }
    gases.close_vacuum(making)
    for flask, needed in sorted((making.needed_nl or {}).items()):
        lot = next(n for n, keys in making.binding.reagents.items() if flask in keys)
        fill(making, flask, lot, needed, NOWHERE)
    _Walk(making).run(expanded)
    shut_down(making)
    return contents


class _Walk:
    """Goes through the acts of a recipe in its order, counted loops as often as they say."""

    def __init__(self, making: Making) -> None:
        self._making = making

    def run(self, expanded: Iterable[Expansion]) -> None:
        making = self._making
        for one in expanded:
            making.act += 1
            making.operation = one.act.name
            if one.unheeded:
                named = ", ".join(one.unheeded)
                place = f"{one.act.name} in line {one.act.place.line}"
                making.note(f"{place}: the recipe says {named}, which no plan does")
            with self._lane(one):
                for operation in one.operations:
                    self._one(operation)
                if one.act.name == "Loop" or (one.act.name == "Repeat" and one.act.repeats is None):
                    self._until_done(one)
                    continue
                for _ in range(one.act.rounds):
                    self.run(one.children)

    def _one(self, operation: BasicOperation) -> None:
        making = self._making
        handler = _HANDLERS.get(operation.kind)
        if handler is None:
            message = f"{making.operation}: no rig can be told to {operation.kind.value} yet"
            making.told.tell("plan.not_compiled", message, operation.place)
            return
        if len(making.steps) >= MOST_STEPS:
            message = f"the plan has more than {MOST_STEPS} steps"
            raise InfeasibleError(message, code="plan.too_many_steps")
        for text in operation.assumed:
            making.note(f"{making.operation}: {text}, of the table of defaults")
        heeded = Heeded(operation.fields)
        handler(making, replace(operation, fields=heeded))
        self._say_unheeded(operation, heeded.unheeded())

    def _say_unheeded(self, operation: BasicOperation, names: Iterable[str]) -> None:
        for name in names:
            place = f"{self._making.operation} in line {operation.place.line}"
            said = operation.fields[name]
            self._making.note(f"{place}: nothing of this rig heeds {name} = {said}")

    def _until_done(self, one: Expansion) -> None:
        """Make a loop that a reading ends, as often as the table of defaults says at most."""
        making, most = self._making, int(default_number(_MOST_ROUNDS))
        if one.act.name == "Loop":
            message = "Loop goes on for ever: say how often, or let a Monitor end a Repeat"
            making.told.tell("plan.open_loop", message, one.act.place)
            return
        making.note(f"{one.act.name}: rounds={_MOST_ROUNDS}, of the table of defaults")
        rounds.until_done(making, one.act.place, most, lambda: self.run(one.children))

    @contextmanager
    def _lane(self, one: Expansion) -> Iterator[None]:
        making = self._making
        before = making.lane
        if one.act.name == "Async":
            pid = one.act.values.get("pid", making.act)
            making.lane = f"{BESIDE}{pid}"
        elif one.act.queue:
            making.lane = f"{before}/{one.act.queue}"
        yield
        making.lane = before


def _render(making: Making, contents: Mapping[str, Any]) -> dict[str, Any]:
    earlier = earlier_steps(making.steps)
    steps = [
        {
            "id": place + 1,
            "of": step.of,
            "does": step.does,
            "actions": step.actions,
            "after": [other + 1 for other in after],
            "estimate_s": step.estimate_s,
        }
        | ({"skip_if": [other + 1 for other in step.skip_if]} if step.skip_if else {})
        for place, (step, after) in enumerate(zip(making.steps, earlier, strict=True))
    ]
    equipment = making.equipment
    drained = [equipment.collecting(key) for key in equipment.vessels if equipment.drains(key)]
    keys = {*equipment.vessels, *(key for key in drained if key is not None)}
    capacities = {key: equipment.capacity_nl(key) for key in keys}
    return {
        "plan": VERSION,
        "bindings": {
            "vessels": dict(sorted(making.binding.vessels.items())),
            "reagents": {n: _flasks(making, n) for n in sorted(making.binding.reagents)},
            **({"chosen": making.chosen} if making.chosen else {}),
        },
        "contents": dict(contents),
        "capacities_ul": {k: micro(c) for k, c in sorted(capacities.items()) if c},
        "steps": steps,
        "totals": _totals(making, critical_path_s(making.steps, earlier)),
        "notes": list(making.notes),
        "groups": {lot: sorted(groups) for lot, groups in sorted(making.chemistry.groups.items())},
    } | ({"keeps_apart": True} if making.meetings.is_any else {})


def _flasks(making: Making, name: str) -> str | list[str]:
    """Return the flask that a reagent comes out of; a list when it comes out of several."""
    keys = making.binding.reagents[name]
    used = [key for key in keys if making.taken_nl.get(key)] or [keys[0]]
    return used[0] if len(used) == 1 else used


def _totals(making: Making, critical_s: float) -> dict[str, Any]:
    needed_nl: dict[str, int] = {}
    for flask, amount in making.taken_nl.items():
        lot = next(n for n, keys in making.binding.reagents.items() if flask in keys)
        needed_nl[lot] = needed_nl.get(lot, 0) + amount
    needed_ug: dict[str, int] = {}
    for held in making.delivered_ug.values():
        for lot, mass in held.items():
            needed_ug[lot] = needed_ug.get(lot, 0) + mass
    by_hand = [c for s in making.steps for g in s.actions for c in g if c["device"] == BY_HAND]
    return {
        "duration_s": round(sum(step.estimate_s for step in making.steps), 3),
        "critical_path_s": critical_s,
        "delivered_ul": {
            key: {lot: micro(amount) for lot, amount in sorted(held.items())}
            for key, held in sorted(making.delivered_nl.items())
        },
        "delivered_ug": {key: dict(held) for key, held in sorted(making.delivered_ug.items())},
        "needed_ul": {lot: micro(amount) for lot, amount in sorted(needed_nl.items())},
        "needed_ug": dict(sorted(needed_ug.items())),
        "by_hand_count": len(by_hand),
    } | (
        {"primed_ul": {lot: micro(nl) for lot, nl in sorted(making.primed_nl.items())}}
        if making.primes
        else {}
    )
