"""What is in each vessel while a plan is made: of every lot the least and the most there can be."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction


@dataclass(frozen=True, slots=True)
class LotShare:
    """How much of one lot there is: nanolitres of a liquid, micrograms of a solid."""

    least: Fraction
    most: Fraction

    def __add__(self, other: LotShare) -> LotShare:
        return LotShare(self.least + other.least, self.most + other.most)

    @property
    def is_certain(self) -> bool:
        """Tell whether nothing is left open."""
        return self.least == self.most


Key = tuple[str, bool]
"""A lot, and whether it is solid."""

Portion = dict[Key, LotShare]
NOTHING = LotShare(Fraction(0), Fraction(0))


def exactly(amount: int) -> LotShare:
    """Return a known amount."""
    return LotShare(Fraction(amount), Fraction(amount))


class RigMatter:
    """The contents of all vessels. A vessel that was never named is empty."""

    def __init__(self) -> None:
        self._held: dict[str, Portion] = {}
        self._layered: set[str] = set()
        """Vessels that were spun: nobody knows which share of a lot is drawn of them."""

    def copy(self) -> RigMatter:
        """Return what is where, to be changed independently."""
        other = RigMatter()
        other._held = {key: dict(portion) for key, portion in self._held.items()}
        other._layered = set(self._layered)
        return other

    def span(self, other: RigMatter) -> None:
        """Know from now on no more than that it is as here or as there."""
        self._layered |= other._layered
        for key in self._held.keys() | other._held.keys():
            here, there = self.held(key), other.held(key)
            self._held[key] = {
                lot: LotShare(
                    min(here.get(lot, NOTHING).least, there.get(lot, NOTHING).least),
                    max(here.get(lot, NOTHING).most, there.get(lot, NOTHING).most),
                )
                for lot in here | there
            }

    def spin(self, vessel: str) -> None:
        """Bring what is in a vessel into layers."""
        self._layered.add(vessel)

    def held(self, vessel: str) -> Portion:
        """Return what is in a vessel."""
        return dict(self._held.get(vessel, {}))

    def liquid(self, vessel: str) -> LotShare:
        """Return how much liquid is in a vessel, in nanolitres."""
        shares = [share for (_, is_solid), share in self.held(vessel).items() if not is_solid]
        return sum(shares, NOTHING)

    def add(self, vessel: str, portion: Portion) -> None:
        """Bring something in."""
        held = self._held.setdefault(vessel, {})
        for key, share in portion.items():
            held[key] = held.get(key, NOTHING) + share

    def is_empty_again(self, vessel: str) -> bool:
        """Tell whether no liquid is left of what was in a vessel: it was not empty all along."""
        return vessel in self._held and not self.liquid(vessel).most

    def empty(self, vessel: str) -> None:
        """Take everything out."""
        self._held[vessel] = {}

    def find_at_least(self, vessel: str, amount_nl: int) -> None:
        """Note that a person has seen at least so much, where one liquid alone is in a vessel."""
        held = self._held.get(vessel, {})
        if len(held) == 1:
            ((key, share),) = held.items()
            held[key] = LotShare(max(share.least, Fraction(amount_nl)), share.most)

    def draw(self, vessel: str, amount_nl: int, *, keeps_solids: bool = False) -> Portion:
        """Take a volume out; of known contents its share of each lot, else what it may be."""
        held, total = self._held.get(vessel, {}), self.liquid(vessel)
        wanted = Fraction(amount_nl)
        if len(held) == 1 and wanted <= total.least:
            # Of one liquid alone it is known what is drawn, however much there is.
            (key,) = held
            left = LotShare(held[key].least - wanted, held[key].most - wanted)
            self._held[vessel] = {key: left} if left.most else {}
            return {key: LotShare(wanted, wanted)}
        is_known = vessel not in self._layered and all(share.is_certain for share in held.values())
        taken: Portion = {}
        for key, share in list(held.items()):
            if key[1] and keeps_solids:
                continue
            if is_known and total.most:
                part = share.most * min(wanted / total.most, Fraction(1))
                taken[key], held[key] = (
                    LotShare(part, part),
                    LotShare(share.most - part, share.most - part),
                )
            elif not is_known:
                taken[key] = _drawn(key, share, wanted, total)
                least = Fraction(0) if key[1] else max(share.least - wanted, Fraction(0))
                held[key] = LotShare(least, share.most - taken[key].least)
        self._forget(vessel)
        return taken

    def draw_all(self, vessel: str, *, keeps_solids: bool = False) -> Portion:
        """Take all liquid out, and solids with it unless they are kept back."""
        held = self._held.get(vessel, {})
        taken = {key: share for key, share in held.items() if not (key[1] and keeps_solids)}
        if not self.liquid(vessel).most:
            taken = {}
        for key in taken:
            del held[key]
        self._forget(vessel)
        return taken

    def part(self, vessel: str) -> Portion:
        """Take all out as two phases: each lot may be in either, so each is told as at most."""
        whole = self.held(vessel)
        self._held[vessel] = {}
        return {key: LotShare(Fraction(0), share.most) for key, share in whole.items()}

    def loosen(self, vessel: str) -> Portion:
        """Let liquids boil off: what stays and what goes are each at most what there was."""
        held = self._held.get(vessel, {})
        gone: Portion = {}
        for key, share in held.items():
            if not key[1]:
                gone[key] = held[key] = LotShare(Fraction(0), share.most)
        return gone

    def _forget(self, vessel: str) -> None:
        held = self._held.get(vessel, {})
        self._held[vessel] = {key: share for key, share in held.items() if share.most}
        if not self.liquid(vessel).most:
            self._layered.discard(vessel)


def _drawn(key: Key, share: LotShare, wanted: Fraction, total: LotShare) -> LotShare:
    """Return what of one lot comes along where nobody knows how the contents are mixed.

    At least what all the other liquids together cannot make up, for the volume is drawn in full.
    """
    if key[1]:
        return LotShare(Fraction(0), share.most)
    most = min(share.most, wanted)
    if wanted > total.least:
        return LotShare(Fraction(0), most)
    others = total.most - share.most
    return LotShare(min(max(wanted - others, Fraction(0)), share.least), most)


def plain(portion: Portion) -> list[dict[str, str | float]]:
    """Render known contents for a plan, in order of lots."""
    return [
        {"lot": lot, "phase": "solid", "mass_ug": float(share.most)}
        if is_solid
        else {"lot": lot, "phase": "liquid", "volume_ul": micro(share.most)}
        for (lot, is_solid), share in sorted(portion.items())
    ]


def micro(amount_nl: Fraction | int) -> float:
    """Return nanolitres as microlitres."""
    return float(Fraction(amount_nl) / 1000)


def lots(portions: Iterable[Key]) -> list[str]:
    """List the lots of a portion."""
    return sorted({lot for lot, _ in portions})
