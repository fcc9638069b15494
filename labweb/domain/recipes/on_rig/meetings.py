"""How much of two lots has met: in vessels by the recipe's own doing, in wastes pour by pour.

Two lots that must not meet may come together in a waste only as far as the one has been with as
much of the other in a vessel of the recipe. A trace that has met the other frees a trace. Liquid is
weighed against liquid and solid against solid, of one lot too: nL and µg are not compared.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from labweb.domain.recipes.on_rig.matter import Key, Portion
from labweb.domain.recipes.xdl.expansion.act_reading import default_number

Amount = Fraction | int | float
Amounts = Mapping[Key, Amount]
"""Lot, and whether it is solid → how much of it, nL or µg."""

Met = Mapping[tuple[Key, Key], Amount]
"""(Lot, other): with how much of the other every bit of the lot has been, nL or µg."""

_TENTH = 10
FILM_NL = int(1_000_000 * default_number("rinse.volume")) // _TENTH
"""What a syringe or valve keeps of a liquid at most: a rinse leaves about a tenth of what was."""


@dataclass(frozen=True, slots=True)
class RigFilm:
    """What wets a syringe or valve with one lot."""

    amount: Amount
    """The most that there can be, nL or µg."""

    washed_nl: int = 0
    """How much of others has gone over since."""

    def or_else(self, other: RigFilm) -> RigFilm:
        """Return what is there at most when it is this or the other."""
        return RigFilm(max(self.amount, other.amount), min(self.washed_nl, other.washed_nl))


@dataclass(frozen=True, slots=True, eq=False)
class Pour:
    """What comes into a waste at once."""

    amounts: Amounts
    """The most of each lot that there can be; infinite: nobody says how much."""

    met: Met = field(default_factory=dict)
    is_film: bool = False
    """It is what wetted syringes and valves. Films are weighed against pours, not each other."""


NO_FILM = Pour({}, is_film=True)


class Meetings:
    """What each vessel holds has met, and what each waste was given."""

    def __init__(
        self, pairs: Collection[frozenset[str]] = (), wastes: Collection[str] = ()
    ) -> None:
        self._pairs = {(one, other) for pair in pairs for one in pair for other in pair - {one}}
        self._wastes = frozenset(wastes)
        self._met: dict[str, dict[tuple[Key, Key], Amount]] = {}
        self._poured: dict[str, list[Pour]] = {}
        self._traces: dict[str, dict[Key, Amount]] = {}
        """Vessel of the recipe → what wetted lines and came into it with something else."""

    def copy(self) -> Meetings:
        """Return what has met, to be changed independently."""
        other = Meetings((), self._wastes)
        other._pairs = self._pairs
        other._met = {key: dict(met) for key, met in self._met.items()}
        other._poured = {key: list(pours) for key, pours in self._poured.items()}
        other._traces = {key: dict(traces) for key, traces in self._traces.items()}
        return other

    def span(self, other: Meetings) -> None:
        """Know from now on no more than that it is as here or as there."""
        for key in self._met.keys() | other._met.keys():
            here, there = self._met.get(key, {}), other._met.get(key, {})
            self._met[key] = {pair: min(here[pair], there[pair]) for pair in here.keys() & there}
        for key, pours in other._poured.items():
            known = self._poured.setdefault(key, [])
            known += [pour for pour in pours if pour not in known]
        for key, traces in other._traces.items():
            own = self._traces.setdefault(key, {})
            own |= {lot: max(amount, own.get(lot, 0)) for lot, amount in traces.items()}

    @property
    def is_any(self) -> bool:
        """Tell whether there is anything that must not meet."""
        return bool(self._pairs)

    def keeps_apart(self, vessel: str) -> bool:
        """Tell whether what comes into a vessel meets there what the recipe never meant to."""
        return vessel in self._wastes

    def of(self, vessel: str) -> Met:
        """Return what the lots in a vessel have met."""
        if vessel not in self._wastes:
            return self._met.get(vessel, {})
        pours = self._poured.get(vessel, ())
        found: dict[tuple[Key, Key], Amount] = {}
        for pair in {pair for pour in pours for pair in pour.met}:
            bits = [pour.met.get(pair, 0) for pour in pours if pair[0] in pour.amounts]
            least = min(bits, default=0)
            if least:
                found[pair] = least
        return found

    def come(self, vessel: str, before: Portion, coming: Portion, met: Met, after: Portion) -> None:
        """Bring something into a vessel: what was in it, what comes, and what is in it then."""
        if not self._pairs:
            return
        if vessel in self._wastes:
            self.pour(vessel, Pour(most_of(coming), met))
            return
        was, comes, there = most_of(before), most_of(coming), least_of(after)
        own = self._met.get(vessel, {})
        known: dict[tuple[Key, Key], Amount] = {}
        for lot in was | comes:
            rows = ([own] if lot in was else []) + ([met] if lot in comes else [])
            others = {other for row in rows for one, other in row if one == lot}
            for other in others | {one for one in there if self.is_pair(lot, one)}:
                least = min(row.get((lot, other), 0) for row in rows)
                if most := max(least, there.get(other, 0)):
                    known[lot, other] = most
        self._met[vessel] = known
        self.trace(vessel, {}, after)

    def is_pair(self, one: Key, other: Key) -> bool:
        """Tell whether two lots must not meet."""
        return (one[0], other[0]) in self._pairs

    def traces(self, vessel: str, held: Portion) -> dict[Key, Amount]:
        """Return what came into a vessel with something else alone, and not because it should."""
        found = dict(self._traces.get(vessel, {}))
        for pour in self._poured.get(vessel, ()):
            for lot, amount in pour.amounts.items() if pour.is_film else ():
                found[lot] = found.get(lot, 0) + amount
        least = least_of(held)
        return {lot: amount for lot, amount in found.items() if least.get(lot, 0) < amount}

    def trace(self, vessel: str, film: Amounts, held: Portion) -> None:
        """Note what came into a vessel of the recipe with something else alone.

        Where as much of it is there anyway, it is no more beside that.
        """
        own, least = self._traces.get(vessel, {}), least_of(held)
        sums = {lot: own.get(lot, 0) + film.get(lot, 0) for lot in own | dict(film)}
        self._traces[vessel] = {lot: n for lot, n in sums.items() if least.get(lot, 0) < n}

    def drain(self, vessel: str) -> None:
        """Note that all of a vessel has gone into another, and what lines brought with it."""
        self._traces.pop(vessel, None)

    def pour(self, waste: str, pour: Pour) -> None:
        """Note what a waste gets."""
        if pour.amounts and self._pairs:
            self._poured.setdefault(waste, []).append(pour)

    def new_in(self, waste: str, lots: Collection[Key]) -> int:
        """Return how many of some lots a waste did not get before."""
        return len(set(lots).difference(*(pour.amounts for pour in self._poured.get(waste, ()))))

    def forget(self, vessel: str) -> None:
        """Note that a vessel is empty."""
        self._met.pop(vessel, None)
        self._poured.pop(vessel, None)
        self.drain(vessel)

    def first(self, waste: str, coming: Pour) -> tuple[str, str] | None:
        """Return what is in a waste and what comes that must not meet it there, the first such."""
        return self._first(self._poured.get(waste, []), coming)

    def first_on(self, films: Amounts, coming: Pour) -> tuple[str, str] | None:
        """Return a lot that wets a part and one that comes over it, and that must not meet."""
        return self._first([Pour(films)], coming)

    def _first(self, pours: Collection[Pour], coming: Pour) -> tuple[str, str] | None:
        there = sorted({lot for pour in pours for lot in pour.amounts})
        for lot in sorted(coming.amounts):
            for other in there:
                if self.is_pair(lot, other) and _meets_anew(pours, coming, lot, other):
                    return other[0], lot[0]
        return None


def _meets_anew(pours: Collection[Pour], coming: Pour, lot: Key, other: Key) -> bool:
    """Tell whether more of a lot meets another than either has met before.

    What has met nothing of its other comes from flasks: of that all is summed up.
    """
    weighed = [pour for pour in pours if not (pour.is_film and coming.is_film)]
    own, has_met = coming.amounts[lot], coming.met.get((lot, other), 0)
    if not has_met:
        own += _fresh(pours, lot, other)
    return _fresh(weighed, other, lot) > has_met or any(
        pour.amounts[other] > has_met and own > met
        for pour in weighed
        if other in pour.amounts and (met := pour.met.get((other, lot)))
    )


def _fresh(pours: Collection[Pour], lot: Key, other: Key) -> Amount:
    """Return how much there is of a lot that has met nothing of another.

    A film was counted in full where it should have gone: it is no more beside that.
    """
    found = [pour for pour in pours if not pour.met.get((lot, other))]
    sums = (sum(p.amounts.get(lot, 0) for p in found if p.is_film is one) for one in (False, True))
    return max(sums)


def most_of(portion: Portion) -> dict[Key, Amount]:
    """Return the most that there can be of each lot."""
    return {lot: share.most for lot, share in portion.items() if share.most}


def least_of(portion: Portion) -> dict[Key, Amount]:
    """Return the least that there is of each lot."""
    return {lot: share.least for lot, share in portion.items()}


def kept_of(portion: Portion) -> dict[Key, Amount]:
    """Return what a part keeps at most: so much of a liquid, of a solid what is in as much of all.

    A solid of which nobody knows how much went over may all have stayed.
    """
    whole = sum(share.least for (_, is_solid), share in portion.items() if not is_solid)
    is_known = whole > FILM_NL and all(share.is_certain for share in portion.values())
    part = FILM_NL / whole if is_known else 1
    return {lot: amount * part if lot[1] else FILM_NL for lot, amount in most_of(portion).items()}
