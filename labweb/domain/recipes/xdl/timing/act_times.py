"""When the acts of a recipe start and end, when each takes as long as it says.

Steps of one queue follow each other; steps of different queues may overlap; a step without a queue
waits for all before it and holds back all after it. Steps inside of a blueprint or a loop have
queues of their own. Two acts never hold the same vessel at once.

Source:
    XDL standard 2.0, "Queues".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import Decimal

from labweb.domain.recipes.xdl.file_format.attribute_values import XdlQuantity
from labweb.domain.recipes.xdl.file_format.xml_tree import refuse
from labweb.domain.recipes.xdl.tables.step_spec import STEPS
from labweb.domain.recipes.xdl.unfolding.act_order import RecipeAct
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import MOST_ACTS

_ZERO = Decimal(0)


@dataclass(frozen=True, slots=True)
class ActTime:
    """One act in time, in seconds from the start of the recipe."""

    act: RecipeAct
    start_s: Decimal
    end_s: Decimal


def own_time_s(act: RecipeAct) -> Decimal:
    """Return the time that a step itself asks for, 0 when it asks for none."""
    time = act.values.get("time")
    return (time.exact or _ZERO) if isinstance(time, XdlQuantity) else _ZERO


def plan_queues(
    acts: tuple[RecipeAct, ...], lasts_s: Callable[[RecipeAct], Decimal] = own_time_s
) -> list[ActTime]:
    """Lay the acts out in time, each as early as its queue and its vessels allow.

    Loops go round as often as they are counted; one that a Monitor ends goes round once.

    Returns:
        Acts that hold no steps themselves, by the time they end; equals in order of the recipe.

    Raises:
        ProtocolError: `xdl.too_many`: counted loops go round more often than can be laid out.
    """
    planner = _Planner(lasts_s)
    planner.lay(acts, _ZERO)
    return sorted(planner.slots, key=lambda slot: slot.end_s)


@dataclass(slots=True)
class _Planner:
    lasts_s: Callable[[RecipeAct], Decimal]
    slots: list[ActTime] = field(default_factory=list)
    busy_until: dict[str, Decimal] = field(default_factory=dict)
    pids: dict[str, Decimal] = field(default_factory=dict)

    def lay(self, acts: tuple[RecipeAct, ...], start: Decimal) -> Decimal:
        """Lay acts of one namespace; return when all of them have ended."""
        barrier, latest = start, start
        queues: dict[str, Decimal] = {}
        for act in acts:
            ready = max(barrier, queues.get(act.queue, start)) if act.queue else latest
            end = self._one(act, ready)
            if act.name == "Async":
                latest = max(latest, ready)
                continue
            latest = max(latest, end)
            if act.queue:
                queues[act.queue] = end
            else:
                barrier = latest
        return max([latest, *self.pids.values()]) if start == _ZERO else latest

    def _one(self, act: RecipeAct, ready: Decimal) -> Decimal:
        if act.name == "Await":
            pid = act.values.get("pid")
            return max(ready, self.pids.get(str(pid), ready))
        if act.children:
            end = ready
            for _ in range(act.rounds):
                end = self.lay(act.children, end)
            if act.name == "Async":
                self.pids[str(act.values.get("pid", f"async {len(self.pids)}"))] = end
            return end
        vessels = vessels_of(act)
        begin = max([ready, *(self.busy_until.get(v, _ZERO) for v in vessels)])
        end = begin + self.lasts_s(act)
        if len(self.slots) >= MOST_ACTS:
            message = f"the recipe goes on for more than {MOST_ACTS} acts"
            raise refuse("xdl.too_many", message, act.place)
        self.busy_until.update(dict.fromkeys(vessels, end))
        self.slots.append(ActTime(act, begin, end))
        return end


def vessels_of(act: RecipeAct) -> list[str]:
    """List the vessels that an act names."""
    spec = STEPS.spec(act.name)
    known = spec.properties if spec is not None else {}
    return [
        str(value)
        for name, value in act.values.items()
        if name in known and known[name].sort == "vessel"
    ]
