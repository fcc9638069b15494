"""Basic operations as steps of a workflow: what any unit operation expands to, said one by one.

```text
Dissolve ─▶ add_liquid, start_stir, set_temperature, await_temperature, wait, stop_temperature
            transfer    start_stir  heat_chill                          wait  stop_heat
```
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal

from labweb.domain.recipes.xdl.expansion.act_reading import ActReading
from labweb.domain.recipes.xdl.expansion.basic_operations import (
    BUFFER,
    KEPT,
    WASTE,
    BasicKind,
    BasicOperation,
    Field,
)
from labweb.domain.recipes.xdl.expansion.operations_table import OPERATIONS
from labweb.domain.recipes.xdl.expansion.unread_properties import Heeded
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.lab_choices.chosen_vessels import Chosen
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared, all_of, stated_at
from labweb.domain.recipes.xdl.tables.defaults_table import DEFAULTS
from labweb.domain.recipes.xdl.timing.stirring_and_heating_between_steps import Made, StepsStanding
from labweb.domain.recipes.xdl.unfolding.act_order import RecipeAct
from labweb.domain.recipes.xdl.unfolding.amounts_said_twice import are_alike, rate_of
from labweb.domain.units import steady
from labweb.domain.workflows.passes.role_requirements import HEAT_TOLERANCE_C
from labweb.domain.workflows.unit_operations.person_steps import LONGEST_QUESTION
from labweb.domain.workflows.unit_operations.unit_operation import ALL

_UL_S_PER_ML_MIN = Decimal(1000) / 60

_REACHED_C = Decimal(str(HEAT_TOLERANCE_C))
"""How near `heat_chill` comes to a temperature before it goes on, unless it says how near."""

_NOT_SAID: Mapping[BasicKind, str] = {
    BasicKind.SET_TEMPERATURE: "heats or chills and does not wait until it is warm or cold",
}
"""Basic operation that no step does → what it does."""


@dataclass(slots=True)
class BasicSteps:
    """Turns acts into steps by way of their expansion, in the order of the recipe."""

    declared: Declared
    chosen: Chosen
    key: Callable[[str, RecipeAct], str]
    """Reference of a name of the recipe, `@key`; tells where it is none."""

    told: Findings
    standing: StepsStanding
    _filtered: int = 0
    _dried: int = 0
    _layers: int = 0
    _waits_in: str = ""
    """Vessel of the recipe in which a layer would wait."""

    _waiting: str = ""
    """Flask in which one waits."""

    def make(self, act: RecipeAct, notes: list[str]) -> list[Made]:
        """Return the steps of an act, the first with the notes of all."""
        known = OPERATIONS.get(act.name)
        expand = None if known is None else known.expand
        if expand is None:
            self._refuse(act, f"has no step that does what {act.name} does")
            return []
        reading, before = ActReading(act, self.told), len(self.told.all)
        operations = list(expand(reading))
        idle = ", ".join(reading.unheeded())
        notes = [*notes, f"{idle} of {act.name}: no plan does it"] if idle else notes
        if len(self.told.all) > before:
            return []
        made: list[Made] = []
        while operations:
            found, count = self._one(act, operations)
            for place, (kind, values, own) in enumerate(found):
                noted = _assumed(operations[:count]) if place == 0 else []
                made.append((kind, values, [*(notes if not made else []), *own, *noted]))
            del operations[:count]
        self._filtered += act.name in ("Filter", "WashSolid")
        self._dried += act.name == "Dry"
        return made

    def _one(self, act: RecipeAct, operations: list[BasicOperation]) -> tuple[list[Made], int]:
        """Return the steps of the first of some operations, and of how many they are."""
        first = operations[0]
        fields = Heeded[Field](first.fields)
        match [operation.kind for operation in operations[:3]]:
            case [BasicKind.START_VACUUM, BasicKind.WAIT, BasicKind.STOP_VACUUM]:
                made, count = self._dry(act, fields, operations), 3
            case [BasicKind.SET_TEMPERATURE, BasicKind.AWAIT_TEMPERATURE, *_]:
                made, count = self._reach(act, fields, operations[1]), 2
            case [BasicKind.START_STIR, BasicKind.WAIT, BasicKind.STOP_STIR | BasicKind.START_STIR]:
                made, count = self._stir(act, fields, operations)
            case [BasicKind.WAIT, BasicKind.SEPARATE_PHASES, *_]:
                seconds = fields.get("seconds")
                fields = Heeded(operations[1].fields)
                made, count = self._part(act, fields, seconds), 2
            case _:
                made, count = self._single(act, fields, first.kind), 1
        for name in fields.unheeded() if made else ():
            self._refuse(act, f"cannot say {name} of what {act.name} does")
        return made, count

    def _single(self, act: RecipeAct, fields: Heeded[Field], kind: BasicKind) -> list[Made]:
        match kind:
            case BasicKind.ADD_LIQUID:
                return self._move(act, fields, "reagent", "vessel")
            case BasicKind.TRANSFER:
                return self._move(act, fields, "source", "target")
            case BasicKind.STOP_STIR:
                return self.standing.stop(self._ref(act, fields, "vessel"))
        makers = {
            BasicKind.DRAW_FILTRATE: self._filter,
            BasicKind.START_STIR: self._start_stir,
            BasicKind.STOP_TEMPERATURE: self._stop_heat,
            BasicKind.AWAIT_TEMPERATURE: self._await,
            BasicKind.WAIT: self._wait,
            BasicKind.ASK: self._ask,
            BasicKind.ADD_SOLID: self._add_solid,
        }
        if kind in makers:
            return makers[kind](act, fields)
        what = _NOT_SAID.get(kind, f"does {kind.replace('_', ' ')}")
        self._refuse(act, f"has no step that {what}, as {act.name} does")
        return []

    def _move(self, act: RecipeAct, fields: Heeded[Field], source: str, target: str) -> list[Made]:
        values = {
            "source": self._ref(act, fields, source),
            "target": self._ref(act, fields, target),
            "volume": self._volume(fields),
            **self._rate(act, fields),
        }
        if fields.get("through"):
            values["through"] = self._ref(act, fields, "through")
        values |= _ports(fields, source_port="from_port", target_port="to_port")
        return [("transfer", values, [])]

    def _filter(self, act: RecipeAct, fields: Heeded[Field]) -> list[Made]:
        values: dict[str, object] = {
            "vessel": self._ref(act, fields, "vessel"),
            "target": self._ref(act, fields, "target"),
        }
        stays = self.declared.stays
        if self._filtered < len(stays) and stays[self._filtered]:
            values["stays"] = all_of(stays[self._filtered])
        asked = fields.get("volume_ml")
        notes = [] if asked is None else [f"volume {asked} mL: all liquid of a filter is drawn off"]
        return [("filter", values, notes)]

    def _dry(
        self, act: RecipeAct, fields: Heeded[Field], operations: list[BasicOperation]
    ) -> list[Made]:
        pressure, seconds = fields.get("pressure_mbar"), operations[1].fields.get("seconds")
        name = str(fields.get("vessel"))
        if pressure is None or operations[2].fields.get("gas"):
            self._refuse(act, f"cannot say the vacuum of {act.name}: it needs a pressure, and air")
            return []
        if not isinstance(seconds, Decimal) or seconds <= 0:
            return []
        values: dict[str, object] = {
            "vessel": self._ref(act, fields, "vessel"),
            "pressure": f"{pressure} mbar",
            "duration": f"{seconds:f} s",
        }
        lots = self.declared.dries_off
        if act.name == "Dry" and self._dried < len(lots) and lots[self._dried]:
            receiver = self.declared.receivers.get(name, "")
            if not receiver:
                message = f"Dry: nobody declared what the vapour of {name!r} condenses in"
                self.told.tell("xdl.not_declared", message, act.place)
            values |= {"dries_off": all_of(lots[self._dried]), "receiver": f"@{receiver}"}
        return [("dry", values, [])]

    def _reach(self, act: RecipeAct, fields: Heeded[Field], window: BasicOperation) -> list[Made]:
        wanted = fields.get("temperature_c")
        low, high = window.fields.get("low_c"), window.fields.get("high_c")
        vessel = self._ref(act, fields, "vessel")
        if not all(isinstance(one, Decimal) for one in (wanted, low, high)):
            return []
        target = Decimal(str(wanted))
        near = min(target - Decimal(str(low)), Decimal(str(high)) - target)
        if near <= 0:
            self._refuse(act, f"cannot say the tolerance of {act.name}: it is not more than 0 °C")
        self.standing.hold(vessel, target, is_held=True)
        values = {"vessel": vessel, "temperature": f"{target:f} °C"}
        values |= {"tolerance": f"{near:f} K"} if near < _REACHED_C else {}
        return [("heat_chill", values, [])]

    def _await(self, act: RecipeAct, fields: Heeded[Field]) -> list[Made]:
        vessel = self._ref(act, fields, "vessel")
        low, high = fields.get("low_c"), fields.get("high_c")
        if not isinstance(low, Decimal) or not isinstance(high, Decimal):
            return []
        values = {"vessel": vessel, **self.standing.comes_to(vessel, low, high)}
        return [("await_temperature", values, [])]

    def _stir(
        self, act: RecipeAct, fields: Heeded[Field], operations: list[BasicOperation]
    ) -> tuple[list[Made], int]:
        """Say stirring for a time in one step, where it ends or another speed follows."""
        seconds, name = operations[1].fields.get("seconds"), fields.get("vessel")
        is_same = operations[2].fields.get("vessel") == name
        is_same &= self.key(str(name), act) not in self.standing.unstirred
        if not is_same or not isinstance(seconds, Decimal) or seconds <= 0:
            return self._start_stir(act, fields), 1
        vessel, speed = self._ref(act, fields, "vessel"), f"{fields.get('speed_rpm')} rpm"
        self.standing.over(vessel)
        values = {"vessel": vessel, "stir_speed": speed, "duration": f"{seconds:f} s"}
        return [("stir", values, [])], 2

    def _part(self, act: RecipeAct, fields: Heeded[Field], settle_s: Field) -> list[Made]:
        """Draw the lower layer, then the upper one; one that goes to where it is stays there."""
        if not isinstance(settle_s, Decimal) or settle_s <= 0:
            self._refuse(act, f"cannot say that layers of {act.name} part in no time")
            return []
        separator, self._waits_in = (
            self._ref(act, fields, "vessel"),
            str(fields.get("waits_in") or ""),
        )
        lower, upper = self._ref(act, fields, "lower_to"), self._ref(act, fields, "upper_to")
        is_back = lower == separator
        drawn: dict[str, object] = {
            "vessel": separator,
            "target": self._buffer(act) if is_back else lower,
            "settle_for": f"{settle_s:f} s",
        }
        lots = stated_at(self.declared.lower_layers, self._layers)
        self._layers += 1
        drawn |= {"lower": all_of(lots)} if lots else {}
        for side, values in (("lower", drawn), ("upper", rest := _all_of(separator, upper))):
            if fields.get(f"{side}_through"):
                values["through"] = self._ref(act, fields, f"{side}_through")
            if not (side == "lower" and is_back):
                values.update(_ports(fields, target_port=f"{side}_port"))
        made: list[Made] = [("separate", drawn, [])]
        made += [("transfer", rest, [])] if upper != separator else []
        back = _all_of(self._waiting, separator)
        back |= _ports(fields, target_port="lower_port") if is_back else {}
        return [*made, *([("transfer", back, [])] if is_back else [])]

    def _buffer(self, act: RecipeAct, place: int = 0) -> str:
        """Return the flask in which a layer waits: of the plan, the recipe, or a declaration."""
        taken = self.chosen.take(act.place, KEPT if place else BUFFER)
        named = self.key(self._waits_in, act) if self._waits_in and not place else ""
        named = f"@{taken}" if taken else named
        if not named or named == f"@{self.declared.waste}":
            if place >= len(self.declared.buffers):
                message = f"{act.name}: nobody declared {place + 1} buffers, in which a layer waits"
                self.told.tell("xdl.not_declared", message, act.place)
                return "@"
            named = f"@{self.declared.buffers[place]}"
        self._waiting = self._waiting if place else named
        return named

    def _start_stir(self, act: RecipeAct, fields: Heeded[Field]) -> list[Made]:
        vessel, speed = self._ref(act, fields, "vessel"), f"{fields.get('speed_rpm')} rpm"
        if self.standing.stirred.get(vessel) == speed or vessel in self.standing.unstirred:
            return []
        self.standing.stirred[vessel] = speed
        return [("start_stir", {"vessel": vessel, "stir_speed": speed}, [])]

    def _stop_heat(self, act: RecipeAct, fields: Heeded[Field]) -> list[Made]:
        vessel = self._ref(act, fields, "vessel")
        if vessel not in self.standing.heated:
            return []
        self.standing.hold(vessel, is_held=False)
        return [("stop_heat", {"vessel": vessel}, [])]

    def _wait(self, act: RecipeAct, fields: Heeded[Field]) -> list[Made]:
        seconds = fields.get("seconds")
        if seconds is None:
            self.told.tell("xdl.left_open", f"{act.name} does not say how long", act.place)
        if not isinstance(seconds, Decimal) or seconds <= 0:
            return []
        return [("wait", {"duration": f"{seconds:f} s"}, [])]

    def _ask(self, act: RecipeAct, fields: Heeded[Field]) -> list[Made]:
        question = str(fields.get("message") or "Go on?").strip()
        if len(question) > LONGEST_QUESTION:
            self._refuse(act, f"asks a person in {LONGEST_QUESTION} characters at most")
        return [("confirm", {"question": question}, [])]

    def _add_solid(self, act: RecipeAct, fields: Heeded[Field]) -> list[Made]:
        mass, over = fields.get("mass_g"), fields.get("over_s")
        if not isinstance(mass, Decimal):
            return []
        values = {
            "source": self._ref(act, fields, "reagent"),
            "target": self._ref(act, fields, "vessel"),
            "mass": f"{mass.normalize():f} g",
        }
        notes = [f"spread over {over:f} s"] if isinstance(over, Decimal) else []
        return [("add_solid", values, notes)]

    def _volume(self, fields: Heeded[Field]) -> str:
        volume = fields.get("volume_ml")
        return f"{volume:f} mL" if isinstance(volume, Decimal) else ALL

    def _rate(self, act: RecipeAct, fields: Heeded[Field]) -> dict[str, str]:
        """Return how fast liquid is moved, where the recipe says so.

        A step draws as fast as it pushes: another rate for that cannot be said.
        """
        over, volume = fields.get("over_s"), fields.get("volume_ml")
        said: dict[str, Decimal] = {}
        if isinstance(over, Decimal) and isinstance(volume, Decimal):
            said["time"] = volume * 1000 / over if over > 0 else Decimal(0)
        for name in ("dispense_ml_min", "rate_ml_min"):
            if isinstance(rate := fields.get(name), Decimal):
                said[name] = rate * _UL_S_PER_ML_MIN
        push = rate_of(act.name, said, act.place, self.told)
        draw = fields.get("aspirate_ml_min")
        if over is not None and "time" not in said:
            self._refuse(act, f"cannot say the time of {act.name} without a volume")
        if fields.get("is_dropwise") and push is None:
            message = "dropwise says no rate: say a time or a speed as well"
            self.told.tell("xdl.left_open", message, act.place)
        if isinstance(draw, Decimal):
            is_same = push is not None and are_alike(draw * _UL_S_PER_ML_MIN, push)
            if not is_same:
                self._refuse(act, f"cannot say how fast {act.name} draws, other than it pushes")
        elif fields.get("is_viscous"):
            self._refuse(act, "cannot say how fast a viscous liquid is drawn")
        return {} if push is None else {"flow_rate": f"{Decimal(str(steady(push))):f} uL/s"}

    def _ref(self, act: RecipeAct, fields: Heeded[Field], name: str) -> str:
        called = str(fields.get(name, ""))
        if called in (BUFFER, KEPT):
            is_given_back = name == "source" and called == BUFFER
            return self._waiting if is_given_back else self._buffer(act, int(called == KEPT))
        if called != WASTE:
            return self.key(called, act)
        waste = self.declared.waste or self.chosen.take(act.place, WASTE)
        if not waste:
            message = f"{act.name}: nobody declared the waste"
            self.told.tell("xdl.not_declared", message, act.place)
        return f"@{waste}"

    def _refuse(self, act: RecipeAct, what: str) -> None:
        self.told.tell("xdl.not_in_workflow", f"a workflow of labweb {what}", act.place)


def _all_of(source: str, target: str) -> dict[str, object]:
    return {"source": source, "target": target, "volume": ALL}


def _ports(fields: Heeded[Field], **names: str) -> dict[str, str]:
    """Return the ports that are named, by the parameter that takes each."""
    return {name: str(fields[own]) for name, own in names.items() if fields.get(own) is not None}


def _assumed(operations: list[BasicOperation]) -> Iterator[str]:
    """Yield what the recipe leaves open and the table of defaults says, with its source."""
    for operation in operations:
        for told in operation.assumed:
            name, _, key = told.partition("=")
            default = DEFAULTS.get(key)
            if default is not None:
                yield f"{name} {default.value}: {default.source}"
