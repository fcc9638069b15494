"""How much of each lot there is in one place, at least and at most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

UNITS_PER_NL = 10**6
"""Amounts are whole numbers of 10⁻⁶ nL (liquids) and 10⁻⁶ µg (solids): shares add up exactly."""


@dataclass(frozen=True, slots=True)
class AmountRange:
    """An amount between two ends, in units."""

    least: int
    most: int

    @classmethod
    def exactly(cls, amount: int) -> AmountRange:
        """Return an amount that is known."""
        return cls(amount, amount)

    @property
    def is_known(self) -> bool:
        """Tell whether both ends are one."""
        return self.least == self.most

    def __add__(self, other: AmountRange) -> AmountRange:
        return AmountRange(self.least + other.least, self.most + other.most)


NOTHING = AmountRange(0, 0)


@dataclass(slots=True)
class Contents:
    """What one place holds. The volume is kept beside the lots: it is often known better."""

    liquids: dict[str, AmountRange] = field(default_factory=dict)
    solids: dict[str, AmountRange] = field(default_factory=dict)
    volume: AmountRange = NOTHING
    is_layered: bool = False
    """It was spun: what is drawn of it holds nobody knows which share of each lot."""

    @property
    def is_known(self) -> bool:
        """Tell whether each part of it holds its share of every liquid lot."""
        return not self.is_layered and all(amount.is_known for amount in self.liquids.values())

    @property
    def holds_nothing(self) -> bool:
        """Tell whether there is no matter for certain."""
        return not self.volume.most and not any(amount.most for amount in self.solids.values())

    def copy(self) -> Contents:
        """Return contents that change independently."""
        return Contents(dict(self.liquids), dict(self.solids), self.volume, self.is_layered)

    def add(self, other: Contents) -> None:
        """Mix in all of `other`."""
        for own, more in ((self.liquids, other.liquids), (self.solids, other.solids)):
            for lot, amount in more.items():
                own[lot] = own.get(lot, NOTHING) + amount
        self.volume = self.volume + other.volume
        self._tighten()

    def find_at_least(self, volume: int) -> None:
        """Note that a person has seen at least `volume`, which is no more than there can be."""
        self.volume = AmountRange(max(self.volume.least, volume), self.volume.most)
        self._tighten()

    def take_everything(self, *, with_solids: bool = True) -> Contents:
        """Take all liquid, and all solids unless they stay behind."""
        taken = Contents(self.liquids, self.solids if with_solids else {}, self.volume)
        self.liquids, self.volume, self.is_layered = {}, NOTHING, False
        if with_solids:
            self.solids = {}
        return taken

    def span(self, other: Contents) -> Contents:
        """Return what there is when it is this or the other."""

        def both(
            one: dict[str, AmountRange], two: dict[str, AmountRange]
        ) -> dict[str, AmountRange]:
            pairs = {lot: (one.get(lot, NOTHING), two.get(lot, NOTHING)) for lot in one | two}
            return {
                k: AmountRange(min(a.least, b.least), max(a.most, b.most))
                for k, (a, b) in pairs.items()
            }

        volume = AmountRange(
            min(self.volume.least, other.volume.least), max(self.volume.most, other.volume.most)
        )
        liquids, solids = both(self.liquids, other.liquids), both(self.solids, other.solids)
        return Contents(liquids, solids, volume, self.is_layered or other.is_layered)

    def take(self, volume: int, *, with_solids: bool = True) -> Contents:
        """Take `volume`, or what there is if that is less; mixed matter goes in proportion."""
        if volume >= self.volume.most:
            return self.take_everything(with_solids=with_solids)
        if self.is_known:
            return self._take_share(volume, with_solids=with_solids)
        drawn = AmountRange(min(volume, self.volume.least), volume)
        rest = AmountRange(max(0, self.volume.least - volume), self.volume.most - volume)
        return self._take_unknown(volume, drawn, rest, with_solids=with_solids)

    def take_lower_phase(self, volume: int) -> Contents:
        """Take up to `volume` of a lower phase of unknown size; every lot may be in either."""
        drawn = AmountRange(0, min(volume, self.volume.most))
        rest = AmountRange(max(0, self.volume.least - volume), self.volume.most)
        return self._take_unknown(volume, drawn, rest, with_solids=True)

    def take_lots(self, parts: Mapping[str, int]) -> Contents:
        """Take so much of each lot, and of no other; no more than there is for certain."""
        taken = {
            lot: min(amount, self.liquids.get(lot, NOTHING).least) for lot, amount in parts.items()
        }
        volume = sum(taken.values())
        for lot, amount in taken.items():
            held = self.liquids.get(lot, NOTHING)
            self.liquids[lot] = AmountRange(held.least - amount, held.most - amount)
        self.liquids = {lot: held for lot, held in self.liquids.items() if held.most}
        self.volume = AmountRange(max(0, self.volume.least - volume), self.volume.most - volume)
        self._tighten()
        exact = {lot: AmountRange.exactly(amount) for lot, amount in taken.items()}
        return Contents(exact, {}, AmountRange.exactly(volume))

    def keep_within(self, limit: Contents) -> None:
        """Note that there is of no lot more than in `limit`."""
        for own, bound in ((self.liquids, limit.liquids), (self.solids, limit.solids)):
            for lot, amount in own.items():
                most = min(amount.most, bound.get(lot, NOTHING).most)
                own[lot] = AmountRange(min(amount.least, most), most)
        self._tighten()

    def keep_at_least(self, least: Mapping[str, int]) -> None:
        """Note that there is of no lot less than so much, which is no more than there can be."""
        for lot, amount in least.items():
            held = self.liquids[lot]
            self.liquids[lot] = AmountRange(max(held.least, min(amount, held.most)), held.most)
        self._tighten()

    def let_go(self) -> Contents:
        """Let an unknown part of the liquid leave, as by boiling, and return that part."""
        gone = Contents(
            {lot: AmountRange(0, amount.most) for lot, amount in self.liquids.items()},
            {},
            AmountRange(0, self.volume.most),
        )
        self.liquids = dict(gone.liquids)
        self.volume = gone.volume
        return gone

    def _take_share(self, volume: int, *, with_solids: bool) -> Contents:
        whole = self.volume.most
        taken = {lot: held.most * volume // whole for lot, held in self.liquids.items()}
        missing = volume - sum(taken.values())
        for lot, held in self.liquids.items():
            more = min(missing, held.most - taken[lot])
            taken[lot] += more
            missing -= more
        solids: dict[str, AmountRange] = {}
        if with_solids:
            for lot, held in self.solids.items():
                share = AmountRange(held.least * volume // whole, held.most * volume // whole)
                solids[lot] = share
                self.solids[lot] = AmountRange(held.least - share.least, held.most - share.most)
        self.liquids = {
            lot: AmountRange.exactly(held.most - taken[lot]) for lot, held in self.liquids.items()
        }
        self.volume = AmountRange.exactly(whole - volume)
        share_of_liquids = {lot: AmountRange.exactly(amount) for lot, amount in taken.items()}
        return Contents(share_of_liquids, solids, AmountRange.exactly(volume))

    def _take_unknown(
        self, volume: int, drawn: AmountRange, rest: AmountRange, *, with_solids: bool
    ) -> Contents:
        taken = Contents(
            {lot: AmountRange(0, min(volume, held.most)) for lot, held in self.liquids.items()},
            {lot: AmountRange(0, held.most) for lot, held in self.solids.items()}
            if with_solids
            else {},
            drawn,
        )
        self.liquids = {
            lot: AmountRange(max(0, held.least - volume), held.most)
            for lot, held in self.liquids.items()
        }
        if with_solids:
            self.solids = dict(taken.solids)
        self.volume = rest
        self._tighten()
        taken._tighten()
        return taken

    def _tighten(self) -> None:
        """Draw the ends together where volume and lots know more than each alone."""
        least = sum(amount.least for amount in self.liquids.values())
        most = sum(amount.most for amount in self.liquids.values())
        self.volume = AmountRange(max(self.volume.least, least), min(self.volume.most, most))
        self.liquids = {
            lot: AmountRange(
                max(amount.least, self.volume.least - (most - amount.most)),
                min(amount.most, self.volume.most - (least - amount.least)),
            )
            for lot, amount in self.liquids.items()
        }
