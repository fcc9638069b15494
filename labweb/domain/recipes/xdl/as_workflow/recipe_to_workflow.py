"""A recipe as a workflow of labweb, when every step of it is one that a workflow has.

A step that a workflow cannot say in full is a finding, not an approximation. Vessels and reagents
become references by key, `@reactor`; whoever opens the workflow in a lab sees what each is bound
to.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any

from labweb.domain.recipes.xdl.as_workflow.basic_steps import BasicSteps
from labweb.domain.recipes.xdl.as_workflow.several_steps import SAID as SEVERAL_SAID
from labweb.domain.recipes.xdl.as_workflow.several_steps import SeveralSteps
from labweb.domain.recipes.xdl.file_format.attribute_values import Value, XdlQuantity
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.read_xdl import refusal
from labweb.domain.recipes.xdl.file_format.xml_tree import NOWHERE
from labweb.domain.recipes.xdl.lab_choices.chosen_vessels import Chosen, OnRig
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared
from labweb.domain.recipes.xdl.tables.step_spec import STEPS
from labweb.domain.recipes.xdl.timing.stirring_and_heating_between_steps import Made, StepsStanding
from labweb.domain.recipes.xdl.unfolding.act_order import RecipeAct
from labweb.domain.recipes.xdl.unfolding.amounts_said_twice import rate_of
from labweb.domain.units import steady
from labweb.domain.workflows.workflow_file import KEY, MOST_STEPS, SCHEMA, check_workflow

_ALWAYS = {"comment", "queue"}
_SAID: Mapping[str, frozenset[str]] = {
    "Add": frozenset({"vessel", "reagent", "volume", "amount", "speed", "stir", "stir_speed"}),
    "Transfer": frozenset({"from_vessel", "to_vessel", "volume", "amount"}),
    "HeatChill": frozenset({"vessel", "temp", "time", "stir", "stir_speed", "purpose"}),
    "HeatChillToTemp": frozenset({"vessel", "temp", "stir", "stir_speed", "purpose"}),
    "Stir": frozenset({"vessel", "time", "stir_speed", "purpose"}),
    "Wait": frozenset({"time"}),
}
"""Step → properties that a workflow can say, or that change nothing in what is done."""

_EXPANDED = frozenset({"Add", "HeatChill", "HeatChillToTemp", "Stir", "Transfer"})
"""Steps with one of their own, which are said by what they expand to where that says too little."""


def to_workflow(
    acts: tuple[RecipeAct, ...],
    *,
    name: str,
    keys: Mapping[str, str] | None = None,
    declared: Declared | None = None,
    rig: OnRig | None = None,
) -> dict[str, Any]:
    """Turn unfolded acts into the plain data of a workflow.

    Args:
        acts: As `unfold_recipe` gives them.
        name: What the workflow is called.
        keys: Vessel or reagent → key of the resource in the lab, where the name is no key.
        declared: What a person states of lab and matter beside the recipe. With it, steps that
            part layers, boil solvents off or let a gas in become steps too.
        rig: What a proved plan says of its rig; None: there is no plan. The rinses of a plan come
            in afterwards (`agreement.weaving`), those that the recipe asks for among them: a
            ResetHandling becomes no step here.

    Raises:
        ProtocolError: `xdl.not_in_workflow`, `xdl.not_a_key`, `xdl.range_not_exact`,
            `xdl.not_declared` and what a workflow refuses; `findings` list all. No workflow
            comes of it.
    """
    known = {**({} if declared is None else declared.keys), **(keys or {})}
    writer = _Writer(known, declared, rig)
    writer.stop(writer.joined(writer.lay(acts)))
    writer.check_declared()
    plain = {
        "schema": SCHEMA,
        "name": name,
        "steps": writer.steps,
        "edges": writer.edges,
    }
    if not writer.told.all:
        writer.told.all += check_workflow(plain)
    if writer.told.all:
        raise refusal(writer.told.all, "recipe as a workflow")
    return plain


@dataclass(slots=True)
class _Writer:
    keys: dict[str, str]
    declared: Declared | None = None
    rig: OnRig | None = None
    told: Findings = field(default_factory=Findings)
    steps: list[dict[str, Any]] = field(default_factory=list)
    edges: list[dict[str, str]] = field(default_factory=list)
    acts_count: int = 0
    beside: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Last steps of each Async that nothing has waited for yet, by its pid."""

    standing: StepsStanding = field(init=False)
    basic: BasicSteps = field(init=False)
    several: SeveralSteps | None = None

    def __post_init__(self) -> None:
        self.standing = StepsStanding(self._number)
        unstirred = frozenset[str]() if self.rig is None else self.rig.unstirred
        self.standing.unstirred = frozenset(f"@{key}" for key in unstirred)
        stated, chosen = self.declared or Declared(), Chosen(self.rig)
        self.basic = BasicSteps(stated, chosen, self._reference, self.told, self.standing)
        if self.declared is not None:
            self.several = SeveralSteps(
                self.declared, chosen, self._key, self._number, self.told, self.standing
            )

    def stop(self, after: tuple[str, ...]) -> None:
        """Write what stops all that still runs behind the last steps."""
        for kind, values, notes in self.standing.end():
            after = self._lay_step(kind, values, notes, after)

    def joined(self, after: tuple[str, ...]) -> tuple[str, ...]:
        """Return some steps, and the last ones of all that went on beside them."""
        ends = [after, *self.beside.values()]
        self.beside = {}
        return tuple(dict.fromkeys(one for end in ends for one in end))

    def check_declared(self) -> None:
        """Tell of reactions behind a step that the recipe does not have."""
        for reaction in () if self.declared is None else self.declared.reactions:
            if reaction.after > self.acts_count:
                message = f"a reaction is declared after step {reaction.after}, there are " + str(
                    self.acts_count
                )
                self.told.tell("xdl.not_declared", message, NOWHERE)

    def lay(self, acts: tuple[RecipeAct, ...], after: tuple[str, ...] = ()) -> tuple[str, ...]:
        """Write acts behind some steps; return the steps that nothing follows yet."""
        barrier: tuple[str, ...] = after
        queues: dict[str, tuple[str, ...]] = {}
        for act in acts:
            if act.queue:
                queues[act.queue] = self._one(act, queues.get(act.queue, barrier))
            else:
                ends = tuple(dict.fromkeys(e for tail in queues.values() for e in tail))
                barrier = self._one(act, ends or barrier)
                queues = {}
        open_ends = tuple(dict.fromkeys(e for tail in queues.values() for e in tail))
        return open_ends or barrier

    def _one(self, act: RecipeAct, after: tuple[str, ...]) -> tuple[str, ...]:
        if act.is_blueprint:
            return self.lay(act.children, after)
        if act.name == "Repeat" and act.repeats is not None:
            for _ in range(act.repeats):
                before = len(self.steps)
                after = self.lay(act.children, after)
                if len(self.steps) == before or len(self.steps) > MOST_STEPS:
                    # Nothing comes of further rounds, or already too much: that is told.
                    break
            return after
        self.acts_count += 1
        if act.name == "Async" and "on_finish" not in act.values:
            # What follows it does not wait for it, but for an Await of its pid.
            pid = str(act.values.get("pid", f"async {self.acts_count}"))
            self.beside[pid] = self.lay(act.children, after)
            return after
        if act.name == "Await":
            ends = (*after, *self.beside.pop(str(act.values.get("pid")), ()))
            return tuple(dict.fromkeys(ends))
        for kind, values, notes in self._steps(act):
            after = self._lay_step(kind, values, notes, after)
        return after

    def _steps(self, act: RecipeAct) -> list[Made]:
        """Return the steps of an act, with the reactions that are declared behind it."""
        made = self._expanded(act)
        if made is None and self.several is not None:
            made = self._made(act, self.several)
        if made is None:
            made = self._simple(act)
        if self.declared is None:
            return made
        here = (r for r in self.declared.reactions if r.after == self.acts_count)
        return [*made, *(("react", dict(reaction.params), []) for reaction in here)]

    def _expanded(self, act: RecipeAct) -> list[Made] | None:
        """Return what an act expands to, where its own step cannot say all of it."""
        if act.name not in _EXPANDED:
            return None
        said = _SAID[act.name]
        if self.several is not None and act.name in SEVERAL_SAID:
            said = said | SEVERAL_SAID[act.name]
        is_said = all(not self._is_more(act.name, n, v, said) for n, v in act.values.items())
        return None if is_said else self.basic.make(act, self._comment(act))

    def _comment(self, act: RecipeAct) -> list[str]:
        comment = act.values.get("comment")
        return [comment] if isinstance(comment, str) and comment else []

    def _made(self, act: RecipeAct, several: SeveralSteps) -> list[Made] | None:
        made = several.make(act, [])
        if made is not None:
            self._check_said(act, SEVERAL_SAID)
        return made

    def _lay_step(
        self, kind: str, values: dict[str, Any], notes: list[str], after: tuple[str, ...]
    ) -> tuple[str, ...]:
        step_id = f"s{len(self.steps) + 1}"
        self.steps.append(
            {
                "id": step_id,
                "kind": kind,
                "params": values,
                "position": {"x": 80.0, "y": 80.0 + 120.0 * len(self.steps)},
                "note": "; ".join(notes)[:4000],
            }
        )
        for source in after:
            self.edges.append(
                {
                    "id": f"e{len(self.edges) + 1}",
                    "source": source,
                    "source_port": "done",
                    "target": step_id,
                    "target_port": "start",
                }
            )
        return (step_id,)

    def _check_said(self, act: RecipeAct, said: Mapping[str, frozenset[str]]) -> None:
        for name, value in act.values.items():
            if self._is_more(act.name, name, value, said[act.name]):
                message = f"a workflow of labweb cannot say {name} of {act.name}"
                self.told.tell("xdl.not_in_workflow", message, act.place)

    def _simple(self, act: RecipeAct) -> list[Made]:
        if act.name == "ResetHandling" and self.rig is not None:
            return []
        notes = self._comment(act)
        said = _SAID.get(act.name)
        if said is None:
            return self.basic.make(act, notes)
        self._check_said(act, _SAID if self.several is None else {**_SAID, **SEVERAL_SAID})
        match act.name:
            case "Add":
                return self._add(act, notes)
            case "Transfer":
                return [("transfer", self._transfer(act), notes)]
            case "Wait":
                return [("wait", {"duration": self._number(act, "time", "s")}, notes)]
            case "Stir":
                return self._stir(act, notes)
        return self._heat(act, notes)

    def _is_more(self, step: str, name: str, value: Value, said: frozenset[str]) -> bool:
        if name in said or name in _ALWAYS:
            return False
        # What is said as the standard has it anyway changes nothing.
        spec = STEPS.steps[step].properties.get(name)
        return spec is None or spec.default is None or spec.default != str(value)

    def _add(self, act: RecipeAct, notes: list[str]) -> list[Made]:
        if isinstance(act.values.get("mass"), XdlQuantity) and "volume" not in act.values:
            message = "a workflow of labweb has no step that adds a solid"
            self.told.tell("xdl.not_in_workflow", message, act.place)
        vessel = self._key(act, "vessel")
        values = {
            "source": self._key(act, "reagent"),
            "target": vessel,
            "volume": self._number(act, "volume", "mL"),
        }
        if "speed" in act.values:
            values["flow_rate"] = self._number(act, "speed", "mL/min")
        elif "time" in act.values:
            self._number(act, "time", "s")
        rate = rate_of(act.name, _rates_ul_s(act), act.place, self.told)
        if rate is not None and "speed" not in act.values:
            values["flow_rate"] = f"{Decimal(str(steady(rate))):f} uL/s"
        before = self.standing.as_said(act, vessel, list(notes))
        return [*before, ("transfer", values, notes)]

    def _transfer(self, act: RecipeAct) -> dict[str, str]:
        return {
            "source": self._key(act, "from_vessel"),
            "target": self._key(act, "to_vessel"),
            "volume": self._number(act, "volume", "mL"),
        }

    def _stir(self, act: RecipeAct, notes: list[str]) -> list[Made]:
        vessel, duration = self._key(act, "vessel"), self._number(act, "time", "s")
        if vessel in self.standing.unstirred:
            return [("wait", {"duration": duration}, [*notes, "nothing stirs it here"])]
        speed = self.standing.speed(act, notes)
        self.standing.over(vessel)
        return [("stir", {"vessel": vessel, "stir_speed": speed, "duration": duration}, notes)]

    def _heat(self, act: RecipeAct, notes: list[str]) -> list[Made]:
        vessel = self._key(act, "vessel")
        values = {"vessel": vessel, "temperature": self._number(act, "temp", "°C")}
        is_held = act.name == "HeatChillToTemp"
        if not is_held:
            values["hold_for"] = self._number(act, "time", "s")
        before = self.standing.as_said(act, vessel, list(notes))
        self.standing.hold(vessel, _exact(act, "temp"), is_held=is_held)
        return [*before, ("heat_chill", values, notes)]

    def _key(self, act: RecipeAct, name: str) -> str:
        return self._reference(str(act.values.get(name, "")), act)

    def _reference(self, called: str, act: RecipeAct) -> str:
        key = self.keys.get(called, called)
        is_key = KEY.fullmatch(key) is not None and (called in self.keys or " " not in key)
        if not is_key:
            message = f"{called!r} is no key of a resource: say which key it has in the lab"
            self.told.tell("xdl.not_a_key", message, act.place)
        return f"@{key}"

    def _number(self, act: RecipeAct, name: str, unit: str) -> str:
        value = act.values.get(name)
        if isinstance(value, XdlQuantity) and value.exact is not None:
            return f"{_plain(value.exact)} {unit}"
        told = value.word.replace("_", " ") if isinstance(value, XdlQuantity) else ""
        what = f"{told!r} is no number" if told else "one value is needed"
        message = f"{name} of {act.name}: {what}; a workflow of labweb wants one"
        self.told.tell("xdl.range_not_exact", message, act.place)
        return ""


def _rates_ul_s(act: RecipeAct) -> dict[str, Decimal]:
    """Return how fast an act says that it adds, by its speed and by its time."""
    speed, time, volume = (_exact(act, name) for name in ("speed", "time", "volume"))
    said = {} if speed is None else {"speed": speed * 1000 / 60}
    if time is not None and volume is not None:
        said["time"] = volume * 1000 / time if time > 0 else Decimal(0)
    return said


def _exact(act: RecipeAct, name: str) -> Decimal | None:
    value = act.values.get(name)
    return value.exact if isinstance(value, XdlQuantity) else None


def _plain(value: Decimal) -> str:
    return f"{value:f}"


def parse_pairs(texts: Iterable[str]) -> dict[str, str]:
    """Read `NAME=VALUE` pairs as a command line gives them.

    Raises:
        ValueError: A text has no `=`, or a name is given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, mark, value = text.partition("=")
        if not mark or not name or not value or name in found:
            raise ValueError(f"{text!r} is not NAME=VALUE, or {name!r} is given twice")
        found[name] = value
    return found
