"""Acts: the steps of a recipe with nothing left open, and the order in which they are done."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from labweb.domain.recipes.xdl.file_format.attribute_values import Value
from labweb.domain.recipes.xdl.file_format.xml_tree import NOWHERE, FilePlace


@dataclass(frozen=True, slots=True, kw_only=True)
class RecipeAct:
    """One step, with every name and amount as it is meant."""

    name: str
    values: Mapping[str, Value] = field(default_factory=dict)
    children: tuple[RecipeAct, ...] = ()
    """Steps of a blueprint, a loop or an Async; those of each round of a loop over variables."""

    is_blueprint: bool = False
    is_monitor: bool = False
    queue: str = ""
    section: str = ""
    place: FilePlace = field(default=NOWHERE, compare=False)

    @property
    def repeats(self) -> int | None:
        """Return how often a Repeat goes round; None when a Monitor ends it."""
        count = self.values.get("repeats", None if self._is_monitored else 1)
        return count if isinstance(count, int) else None

    @property
    def rounds(self) -> int:
        """Return how often the children are carried out, 0 too; once where a Monitor ends them."""
        count = self.repeats if self.name == "Repeat" else 1
        return 1 if count is None else count

    @property
    def _is_monitored(self) -> bool:
        return any(child.is_monitor for child in self.children)


def in_order(
    acts: tuple[RecipeAct, ...], is_done: Callable[[RecipeAct, int], bool]
) -> Iterator[RecipeAct]:
    """Yield the acts in the order of execution, queues aside.

    Args:
        acts: As `unfold` gives them.
        is_done: Asked after a Monitor was carried out, with how often it was since its Repeat
            began. All Monitors of a Repeat have to be done in the same round, which is
            carried out to its end.
    """
    for act in acts:
        if act.name != "Repeat":
            yield act
            yield from in_order(act.children, is_done)
            continue
        count, rounds = act.repeats, 0
        while rounds != count:
            rounds += 1
            yield from in_order(act.children, is_done)
            monitors = [child for child in act.children if child.is_monitor]
            if count is None and all(is_done(monitor, rounds) for monitor in monitors):
                break
