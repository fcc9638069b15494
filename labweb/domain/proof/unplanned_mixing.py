"""Which lots meet where the recipe did not bring them together, and how much of them at once.

In a vessel that the plan binds for the recipe lots come together because the recipe says so. In any
other, a waste or a flask that vapour condenses in, no two may that must not, unless one of the two
has been, in vessels of the recipe, with as much of the other as it now finds. Liquid is weighed
against liquid and solid against solid, of one lot too: nanolitres and micrograms are not compared.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain

from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, Contents

FILM = 300_000 * UNITS_PER_NL
"""What one syringe or valve carries over of a liquid: a tenth of a rinse of 3 mL."""

_GRAIN = UNITS_PER_NL // 2
Enmities = Mapping[frozenset[str], str]
"""Two lots that must not meet → what comes of it."""

Item = tuple[str, bool]
"""A lot, and whether it is there as a solid."""

Company = Mapping[Item, int]
"""Other lot → how much of it a lot has been with, in units."""


@dataclass(frozen=True, slots=True, eq=False)
class Gift:
    """One lot that came into a vessel with one step."""

    item: Item
    amount: int
    company: Company = field(default_factory=dict)
    is_film: bool = False


@dataclass(frozen=True)
class Memory:
    """What is known at one moment."""

    company: Mapping[tuple[str, Item], Company]
    gifts: Mapping[str, tuple[Gift, ...]]
    traces: Mapping[str, Mapping[Item, int]]


class Encounters:
    """Follows the company of each lot in each vessel, and what came into vessels of nobody."""

    def __init__(self, enmities: Enmities) -> None:
        self.enmities = enmities
        self._company: dict[tuple[str, Item], Company] = {}
        """Vessel and lot → with how much of each enemy every bit of it has been."""

        self._gifts: dict[str, tuple[Gift, ...]] = {}
        self._traces: dict[str, dict[Item, int]] = {}
        """Vessel of the recipe → what wetted lines and came into it with something else."""

    def remember(self) -> Memory:
        """Return what is known now."""
        traces = {vessel: dict(items) for vessel, items in self._traces.items()}
        return Memory(dict(self._company), dict(self._gifts), traces)

    def may_be(self, memory: Memory) -> None:
        """Know from now on no more than that it is as here or as in a memory."""
        for key in self._company.keys() | memory.company.keys():
            one, two = self._company.get(key, {}), memory.company.get(key, {})
            self._company[key] = {item: min(one[item], two[item]) for item in one.keys() & two}
        for vessel, gifts in memory.gifts.items():
            here = self._gifts.get(vessel, ())
            self._gifts[vessel] = here + tuple(gift for gift in gifts if gift not in here)
        for vessel, traces in memory.traces.items():
            own = self._traces.setdefault(vessel, {})
            own |= {item: max(amount, own.get(item, 0)) for item, amount in traces.items()}

    def outcome(self, one: Item, other: Item) -> str | None:
        """Return what comes of two that must not meet; None: they may."""
        return self.enmities.get(frozenset((one[0], other[0])))

    def traces(self, vessel: str, held: Contents) -> dict[Item, int]:
        """Return what came into a vessel with something else alone, and not because it should."""
        least, found = amounts(held, least=True), dict(self._traces.get(vessel, {}))
        for gift in self._gifts.get(vessel, ()):
            if gift.is_film:
                found[gift.item] = found.get(gift.item, 0) + gift.amount
        return {item: most for item, most in found.items() if least.get(item, 0) + _GRAIN < most}

    def trace(self, vessel: str, film: Mapping[Item, int], now: Contents) -> None:
        """Note what came into a vessel of the recipe with something else alone.

        Where as much of it is there anyway, it is no more beside that.
        """
        own, least = self._traces.get(vessel, {}), amounts(now, least=True)
        sums = {item: own.get(item, 0) + film.get(item, 0) for item in own | dict(film)}
        self._traces[vessel] = {
            item: most for item, most in sums.items() if least.get(item, 0) + _GRAIN < most
        }

    def company(self, vessels: Collection[str], item: Item) -> Company:
        """Return the company of a lot that comes out of one or several vessels."""
        known: list[Company] = [
            self._company[vessel, item] for vessel in vessels if (vessel, item) in self._company
        ]
        known += [g.company for v in vessels for g in self._gifts.get(v, ()) if g.item == item]
        if not known:
            return {}
        shared = set(known[0]).intersection(*known[1:])
        return {other: min(one[other] for one in known) for other in shared}

    def empty(self, vessel: str) -> None:
        """Forget what came into a vessel."""
        self._gifts.pop(vessel, None)
        self.drain(vessel)

    def drain(self, vessel: str) -> None:
        """Note that all of a vessel has gone into another, and what lines brought with it."""
        self._traces.pop(vessel, None)

    def give(self, vessel: str, gifts: Iterable[Gift]) -> None:
        """Put lots into a vessel in which nobody brings them together."""
        if self.enmities:
            self._gifts[vessel] = (*self._gifts.get(vessel, ()), *gifts)

    def mix(self, vessel: str, before: Contents, gifts: Collection[Gift], now: Contents) -> None:
        """Let lots come together in a vessel of the recipe."""
        if not self.enmities:
            return
        had, least = amounts(before), amounts(now, least=True)
        items = had.keys() | {gift.item for gift in gifts}
        new = {}
        for item in items:
            bits = [self._company.get((vessel, item), {})] if item in had else []
            bits += [gift.company for gift in gifts if gift.item == item]
            new[vessel, item] = {
                other: most
                for other in self._enemies(item, chain(least, *bits))
                if (most := max(min(bit.get(other, 0) for bit in bits), least.get(other, 0)))
            }
        for key in [key for key in self._company if key[0] == vessel]:
            del self._company[key]
        self._company |= new

    def find(self, vessel: str, gifts: Collection[Gift]) -> Iterator[str]:
        """Yield what comes together in a vessel of nobody and must not."""
        there = self._gifts.get(vessel, ())
        for gift in gifts:
            for other in sorted(self._enemies(gift.item, (one.item for one in there))):
                if self._is_new(there, gift, other):
                    outcome = self.outcome(gift.item, other)
                    yield f"{gift.item[0]} meets {other[0]} ({outcome}) in {vessel}"

    def find_on_film(self, films: Mapping[Item, int], coming: Mapping[Item, Company]) -> str:
        """Return what meets on a syringe or valve that films wet; "": nothing that must not."""
        for wet, amount in sorted(films.items()):
            for item in sorted(self._enemies(wet, coming)):
                if coming[item].get(wet, 0) + _GRAIN < amount:
                    return f"{item[0]} meets {wet[0]} ({self.outcome(wet, item)})"
        return ""

    def find_traced(self, gifts: Collection[Gift], traces: Mapping[Item, int]) -> Iterator[str]:
        """Yield what comes onto something that lines have brought into a vessel before."""
        for gift in gifts:
            for item in sorted(self._enemies(gift.item, traces)):
                if gift.company.get(item, 0) + _GRAIN < traces[item]:
                    outcome = self.outcome(gift.item, item)
                    yield f"{gift.item[0]} meets {item[0]}, which came with wet lines ({outcome})"

    def _enemies(self, item: Item, among: Iterable[Item]) -> set[Item]:
        return {other for other in among if self.outcome(item, other) is not None}

    def _is_new(self, there: Collection[Gift], gift: Gift, other: Item) -> bool:
        """Tell whether a lot finds more of another than either of them has been with."""
        if gift.is_film:
            there = [one for one in there if not one.is_film]
        known = gift.company.get(other, 0) + _GRAIN
        strange = _strangers(there, other, gift.item)
        if strange > known:
            return True
        mine = gift.amount
        if not gift.company.get(other):
            mine += _strangers(there, gift.item, other)
        return any(
            one.amount > known and mine > one.company[gift.item] + _GRAIN
            for one in there
            if one.item == other and one.company.get(gift.item)
        )


def amounts(contents: Contents, *, least: bool = False) -> dict[Item, int]:
    """Return how much there is of each lot, as liquid and as solid, at most or at least."""
    return {
        (lot, is_solid): amount.least if least else amount.most
        for is_solid, part in ((False, contents.liquids), (True, contents.solids))
        for lot, amount in part.items()
        if amount.most
    }


def _strangers(gifts: Collection[Gift], item: Item, to: Item) -> int:
    """Return how much of a lot there is that was never with another.

    Films are no more beside what was poured: that was counted in full where it was to go.
    """
    found = [gift for gift in gifts if gift.item == item and not gift.company.get(to)]
    poured = sum(gift.amount for gift in found if not gift.is_film)
    return max(poured, sum(gift.amount for gift in found if gift.is_film))
