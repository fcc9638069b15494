"""What goes on in the vessels between the steps of a recipe: stirring and heating.

A plan keeps stirring and heating until an act says otherwise, and stops the rest at its end. A
workflow that is made of the same recipe has to do the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any

from labweb.domain.recipes.xdl.tables.defaults_table import DEFAULTS
from labweb.domain.recipes.xdl.tables.step_spec import STEPS
from labweb.domain.recipes.xdl.unfolding.act_order import RecipeAct

Made = tuple[str, dict[str, Any], list[str]]
"""Kind, parameters and notes of one step."""


@dataclass(slots=True)
class StepsStanding:
    """Follows the steps as they are written."""

    number: Callable[[RecipeAct, str, str], str]
    """A property as one number with a unit; tells where it is none."""

    unstirred: frozenset[str] = frozenset()
    """Vessels that nothing stirs on the rig of a plan: there a recipe is done without."""

    stirred: dict[str, str] = field(default_factory=dict)
    """Speed by vessel that is being stirred."""

    heated: dict[str, None] = field(default_factory=dict)
    """Vessels that are kept at a temperature, in order."""

    set_c: dict[str, Decimal] = field(default_factory=dict)
    """To what each vessel was heated or chilled last."""

    def as_said(self, act: RecipeAct, vessel: str, notes: list[str]) -> list[Made]:
        """Return the step that stirs a vessel, or stops it, as an act says; often none.

        An Add that does not speak of stirring is done without, as in a plan.
        """
        if vessel in self.unstirred:
            return []
        if not self.stirs(act):
            is_stopped = act.values.get("stir") is False or act.name == "Add"
            return self.stop(vessel) if is_stopped else []
        speed = self.speed(act, notes)
        if self.stirred.get(vessel) == speed:
            return []
        self.stirred[vessel] = speed
        return [("start_stir", {"vessel": vessel, "stir_speed": speed}, notes)]

    def stirs(self, act: RecipeAct) -> bool:
        """Tell whether an act stirs: as it says, else as the standard has it."""
        said = act.values.get("stir")
        if isinstance(said, bool):
            return said
        known = STEPS.steps[act.name].properties.get("stir")
        return known is not None and known.default == "True"

    def stop(self, vessel: str) -> list[Made]:
        """Return the step that stops stirring a vessel, where somebody began."""
        return [("stop_stir", {"vessel": vessel}, [])] if self.stirred.pop(vessel, "") else []

    def over(self, vessel: str) -> None:
        """Note that a step has stopped stirring by itself."""
        self.stirred.pop(vessel, None)

    def hold(self, vessel: str, set_c: Decimal | None = None, *, is_held: bool) -> None:
        """Note to what a step has brought a vessel, and whether that is kept after it."""
        self.heated.pop(vessel, None)
        if set_c is not None:
            self.set_c[vessel] = set_c
        if is_held:
            self.heated[vessel] = None

    def comes_to(self, vessel: str, low_c: Decimal, high_c: Decimal) -> dict[str, str]:
        """Return the limits at which a vessel is warm or cold by itself.

        One that was hotter cools down, and may be colder than the window when somebody looks.
        """
        lowest, highest = {"lowest": f"{low_c:f} °C"}, {"highest": f"{high_c:f} °C"}
        last_c = self.set_c.get(vessel)
        if last_c is not None and last_c > high_c:
            return highest
        return lowest if last_c is not None and last_c < low_c else lowest | highest

    def end(self) -> list[Made]:
        """Return the steps that stop everything that still runs."""
        kinds = dict.fromkeys(self.stirred, "stop_stir")
        kinds |= dict.fromkeys(self.heated, "stop_heat_stir")
        self.stirred, self.heated = {}, {}
        return [(kind, {"vessel": vessel}, []) for vessel, kind in sorted(kinds.items())]

    def speed(self, act: RecipeAct, notes: list[str]) -> str:
        """Return the speed that an act says, else that of the table of defaults, with a note."""
        if "stir_speed" in act.values:
            return self.number(act, "stir_speed", "rpm")
        default = DEFAULTS["stir_speed"]
        notes.append(f"stirring speed {default.value}: {default.source}")
        return default.value.replace("RPM", "rpm")
