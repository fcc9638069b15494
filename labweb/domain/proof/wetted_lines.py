"""What wets syringes and valves: how much of it, for how long, and where it was under way to."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, Contents
from labweb.domain.proof.unplanned_mixing import FILM, Item, amounts

WASHED = 9_000_000 * UNITS_PER_NL
"""Something is gone from a syringe or valve when so much of others has gone over it since."""


@dataclass(frozen=True, slots=True)
class Film:
    """One lot that wets a syringe or valve."""

    amount: int
    """How much of it there is at most, in units."""

    washed: int = 0
    """How much of others has gone over it since."""


@dataclass(frozen=True, slots=True)
class Wetted:
    """What is known of all syringes and valves at one moment."""

    films: Mapping[str, Mapping[Item, Film]]
    went: Mapping[str, Mapping[Item, frozenset[str]]]


class Lines:
    """Follows what wets each syringe and valve, and what the step that goes on does to it."""

    def __init__(self) -> None:
        self._films: dict[str, dict[Item, Film]] = {}
        self._went: dict[str, dict[Item, frozenset[str]]] = {}
        """Syringe or valve → lot that wets it → vessels that it was under way to."""

        self._before: Mapping[str, Mapping[Item, Film]] = {}
        self._passed: set[str] = set()
        self._own: dict[str, dict[str, set[Item]]] = {}
        """Syringe or valve → vessel or gas → what of it goes over in this step."""

    def remember(self) -> Wetted:
        """Return what is known now."""
        films = {part: dict(items) for part, items in self._films.items()}
        return Wetted(films, {part: dict(items) for part, items in self._went.items()})

    def may_be(self, past: Wetted) -> None:
        """Know from now on no more than that it is as here or as there."""
        for part, items in past.films.items():
            here = self._films.setdefault(part, {})
            for item, film in items.items():
                own = here.get(item, film)
                here[item] = Film(max(film.amount, own.amount), min(film.washed, own.washed))
        for part, ends in past.went.items():
            mine = self._went.setdefault(part, {})
            mine |= {item: keys | mine.get(item, frozenset()) for item, keys in ends.items()}

    def begin(self) -> None:
        """Begin a step."""
        self._before = {part: dict(items) for part, items in self._films.items()}
        self._passed, self._own = set(), {}

    def meet(self, part: str, origin: str, coming: Contents) -> list[tuple[set[Item], set[Item]]]:
        """Return what comes over a part, and which films it finds there.

        What goes over it a second time in a step meets there what it left there itself: it was
        together in the vessel that it comes out of. What others left, it met the first time.
        """
        self._passed.add(part)
        new, wet = {*amounts(coming)}, {*self._films.get(part, {})}
        own = self._own.get(part, {}).get(origin, set())
        return [(new - own, wet), (new & own, wet - own)]

    def amounts_on(self, part: str) -> dict[Item, int]:
        """Return how much of each lot wets a part, at most."""
        return {item: film.amount for item, film in self._films.get(part, {}).items()}

    def wet(self, part: str, origin: str, coming: Contents) -> None:
        """Let liquid go over a syringe or valve, and wash what was there before."""
        kept = _kept(coming)
        if not kept:
            return
        old = self._films.get(part, {})
        films = {
            item: Film(film.amount, film.washed + coming.volume.least)
            for item, film in old.items()
            if film.washed + coming.volume.least < WASHED
        }
        for item, amount in kept.items():
            films[item] = Film(max(amount, films[item].amount if item in films else 0))
        self._films[part] = films
        self._own.setdefault(part, {}).setdefault(origin, set()).update(kept)

    def carried(
        self, flowed: Collection[Item], vessel: str = "", meant: Collection[Item] = ()
    ) -> dict[Item, int]:
        """Return what wetted the lines of this step before, and is carried where they lead to.

        Not what flows itself in the step, nor, of what is `meant`, what went over them into that
        vessel only.
        """
        found: dict[Item, int] = {}
        for part in self._passed:
            for item, film in self._before.get(part, {}).items():
                is_own = self._went.get(part, {}).get(item) == frozenset((vessel,))
                if item not in flowed and not (is_own and item in meant):
                    found[item] = found.get(item, 0) + film.amount
        return found

    def finish(self, ends: frozenset[str]) -> None:
        """End a step: note which vessels what went over each part was under way to."""
        for part, origins in self._own.items():
            old, before = self._went.get(part, {}), self._before.get(part, {})
            known = {item: old[item] for item in self._films.get(part, {}) if item in old}
            for item in set[Item]().union(*origins.values()):
                known[item] = ends | (old.get(item, ends) if item in before else ends)
            self._went[part] = known


def _kept(coming: Contents) -> dict[Item, int]:
    """Return what a part keeps at most: so much of a liquid, of a solid what is in as much of all.

    A solid of which nobody knows how much went over may all have stayed.
    """
    whole = coming.volume.least
    kept = dict.fromkeys(amounts(Contents(coming.liquids)), FILM)
    for lot, amount in coming.solids.items():
        is_known = amount.least == amount.most and whole > FILM
        most = amount.most * FILM // whole if is_known else amount.most
        if amount.most:
            kept[lot, True] = most
    return kept
