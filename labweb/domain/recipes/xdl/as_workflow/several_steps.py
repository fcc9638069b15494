"""Steps of a recipe that a workflow says in several: boiling off, letting gas in, eluting.

What the recipe leaves open is taken from what a person declared, step by step in order, and from
the table of defaults, which the notes of the step name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from labweb.domain.recipes.xdl.expansion.basic_operations import WASTE
from labweb.domain.recipes.xdl.file_format.attribute_values import XdlQuantity
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.lab_choices.chosen_vessels import Chosen
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared, all_of, stated_at
from labweb.domain.recipes.xdl.tables.defaults_table import DEFAULTS
from labweb.domain.recipes.xdl.timing.stirring_and_heating_between_steps import Made, StepsStanding
from labweb.domain.recipes.xdl.unfolding.act_order import RecipeAct
from labweb.domain.workflows.unit_operations.unit_operation import ALL

SAID: Mapping[str, frozenset[str]] = {
    "Add": frozenset(
        {"vessel", "reagent", "volume", "amount", "time", "speed", "stir", "stir_speed"}
        | {"dropwise"}
    ),
    "Transfer": frozenset({"from_vessel", "to_vessel", "volume", "amount", "through"}),
    "HeatChill": frozenset({"vessel", "temp", "time", "stir", "stir_speed", "purpose"}),
    "HeatChillToTemp": frozenset({"vessel", "temp", "stir", "stir_speed", "purpose"}),
    "Stir": frozenset({"vessel", "time", "stir_speed", "purpose"}),
    "Wait": frozenset({"time"}),
    "EvacuateAndRefill": frozenset(
        {"vessel", "gas", "repeats", "vacuum_pressure"}
        | {"after_vacuum_wait_time", "after_inert_gas_wait_time"}
    ),
    "Evaporate": frozenset({"vessel", "temp", "pressure", "time", "stir_speed", "mode"}),
    "FilterThrough": frozenset(
        {"from_vessel", "to_vessel", "through", "eluting_solvent", "eluting_volume"}
        | {"eluting_repeats"}
    ),
}
"""Step → properties that a workflow can say when a person declares what else is needed."""

_DISPLAY = {"time": "s", "pressure": "mbar", "rotation": "rpm", "temperature": "°C", "volume": "mL"}


@dataclass(slots=True)
class SeveralSteps:
    """Turns acts into steps, in the order of the recipe."""

    declared: Declared
    chosen: Chosen
    key: Callable[[RecipeAct, str], str]
    """Reference of what a property names, `@key`."""

    number: Callable[[RecipeAct, str, str], str]
    """A property as one number with a unit; tells where it is none."""

    told: Findings
    standing: StepsStanding
    _boiled: int = 0

    def make(self, act: RecipeAct, notes: list[str]) -> list[Made] | None:
        """Return the steps of an act; None: the simple rules do for it."""
        match act.name:
            case "Transfer" if _is_all(act):
                return [self._transfer(act, "from_vessel", "to_vessel", notes)]
            case "EvacuateAndRefill":
                return [self._evacuate(act, notes)]
            case "Evaporate":
                return self._evaporate(act, notes)
            case "FilterThrough":
                return self._filter_through(act, notes)
        return None

    def _known(self, act: RecipeAct, name: str, what: str, notes: list[str]) -> str:
        """Return a property, or the value of the table of defaults with a note of it."""
        if name in act.values:
            value = act.values[name]
            sort = value.sort if isinstance(value, XdlQuantity) else ""
            return self.number(act, name, _DISPLAY.get(sort, ""))
        default = DEFAULTS[what]
        notes.append(f"{name} {default.value}: {default.source}")
        return default.value.replace("RPM", "rpm")

    def _transfer(self, act: RecipeAct, source: str, target: str, notes: list[str]) -> Made:
        values = {
            "source": self.key(act, source),
            "target": self.key(act, target),
            "volume": ALL,
        }
        if "through" in act.values:
            values["through"] = self.key(act, "through")
        return "transfer", values, notes

    def _evacuate(self, act: RecipeAct, notes: list[str]) -> Made:
        repeats = act.values.get("repeats")
        if repeats is None:
            repeats = DEFAULTS["evacuate.repeats"].value
            notes.append(f"repeats {repeats}: {DEFAULTS['evacuate.repeats'].source}")
        values = {
            "vessel": self.key(act, "vessel"),
            "gas": self.key(act, "gas"),
            "pressure": self._known(act, "vacuum_pressure", "evacuate.pressure", notes),
            "rounds": str(repeats),
            "vacuum_for": self._known(act, "after_vacuum_wait_time", "evacuate.vacuum_time", notes),
            "gas_for": self._known(act, "after_inert_gas_wait_time", "evacuate.gas_time", notes),
        }
        return "evacuate_refill", values, notes

    def _drain(self, act: RecipeAct, receiver: str) -> list[Made]:
        """Return what empties the receiver, as in a plan: it has room for the next."""
        waste = self.declared.waste or self.chosen.take(act.place, WASTE)
        if not waste and self.chosen.is_planned:
            return []
        if not waste:
            message = f"{act.name}: nobody declared the waste"
            self.told.tell("xdl.not_declared", message, act.place)
        return [("transfer", {"source": f"@{receiver}", "target": f"@{waste}", "volume": ALL}, [])]

    def _evaporate(self, act: RecipeAct, notes: list[str]) -> list[Made]:
        gone = stated_at(self.declared.boils_off, self._boiled)
        self._boiled += 1
        called = str(act.values.get("vessel", ""))
        receiver = self.declared.receivers.get(called, "")
        if not receiver:
            message = f"Evaporate: nobody declared what the vapour of {called!r} condenses in"
            self.told.tell("xdl.not_declared", message, act.place)
        values: dict[str, object] = {
            "vessel": self.key(act, "vessel"),
            "receiver": f"@{receiver}",
            "temperature": self._known(act, "temp", "rotavap.temperature", notes),
            "pressure": self.number(act, "pressure", "mbar"),
            "speed": self._known(act, "stir_speed", "rotavap.rotation_speed", notes),
            "duration": self.number(act, "time", "s"),
        }
        values |= {"boils_off": all_of(gone)} if gone else {}
        if act.values.get("mode") == "auto":
            notes.append("mode auto: it lasts all of its time, for it does not end by itself")
        return [("evaporate", values, notes), *self._drain(act, receiver)]

    def _filter_through(self, act: RecipeAct, notes: list[str]) -> list[Made]:
        made = [self._transfer(act, "from_vessel", "to_vessel", notes)]
        if "eluting_solvent" not in act.values:
            return made
        repeats = act.values.get("eluting_repeats", 1)
        rinse = {
            "source": self.key(act, "eluting_solvent"),
            "target": self.key(act, "from_vessel"),
            "volume": self.number(act, "eluting_volume", "mL"),
        }
        for _ in range(repeats if isinstance(repeats, int) else 1):
            made.append(("transfer", dict(rinse), []))
            made.append(self._transfer(act, "from_vessel", "to_vessel", []))
        return made


def _is_all(act: RecipeAct) -> bool:
    volume = act.values.get("volume", act.values.get("amount"))
    return isinstance(volume, XdlQuantity) and volume.word == ALL
