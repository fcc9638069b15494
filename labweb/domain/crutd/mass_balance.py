"""What a run did with matter: where mass came from and went to, and what a reaction yielded.

Both follow from the ledger alone: its entries, and the reactions that are on record.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.crutd.operations import React
from labweb.domain.resources.contents_by_lot import LotId


@dataclass(frozen=True, slots=True, kw_only=True)
class LotFacts:
    """What is stated of a lot and its material."""

    key: str
    density_mg_ul: float | None = None
    """None: its volume cannot be told as a mass."""

    concentration_mmol_l: float | None = None
    """None: its volume cannot be told as an amount of substance."""

    def mass_ug(self, amount_nl: int, amount_ug: int) -> int | None:
        """Return the mass of an amount; None: nobody stated the density."""
        if not amount_nl:
            return amount_ug
        # A density in mg/µL is the same figure in µg/nL.
        return None if self.density_mg_ul is None else round(amount_nl * self.density_mg_ul)

    def amount_umol(self, amount_nl: int, amount_ug: int) -> float | None:
        """Return the amount of substance; None: nobody stated what it takes to tell.

        Example:
            >>> ether = LotFacts(key="ether", density_mg_ul=0.706, concentration_mmol_l=9525.0)
            >>> ether.amount_umol(1_000_000, 0)
            9525.0
            >>> round(ether.amount_umol(0, 706_000))
            9525
        """
        if self.concentration_mmol_l is None:
            return None
        if amount_nl:
            # mmol/L times nL is 1e-6 µmol.
            return amount_nl * self.concentration_mmol_l / 1_000_000
        if self.density_mg_ul is None:
            return None
        return amount_ug / self.density_mg_ul * self.concentration_mmol_l / 1_000_000


@dataclass(frozen=True, slots=True)
class MassMove:
    """One posted entry."""

    lot: LotId
    debit: str
    credit: str
    amount_nl: int = 0
    amount_ug: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class AccountChange:
    """What an account lost or gained in all."""

    account: str
    """Id of a vessel, or a nominal account."""

    lots_ug: Mapping[LotId, int]
    """Mass by lot; negative where it left."""

    @property
    def total_ug(self) -> int:
        """All lots together."""
        return sum(self.lots_ug.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class MassBalance:
    """Where mass came from and where it went; `gap_ug` says by how much the sides differ."""

    taken: tuple[AccountChange, ...]
    brought: tuple[AccountChange, ...]
    unknown: tuple[LotId, ...] = ()
    """Lots that moved and whose density nobody stated: they are in neither side."""

    @property
    def taken_ug(self) -> int:
        """What left, as a positive figure."""
        return -sum(change.total_ug for change in self.taken)

    @property
    def brought_ug(self) -> int:
        """What arrived."""
        return sum(change.total_ug for change in self.brought)

    @property
    def gap_ug(self) -> int:
        """What arrived more than left: only the rounding of masses, when all is on record."""
        return self.brought_ug - self.taken_ug


def mass_balance(moves: Iterable[MassMove], lots: Mapping[LotId, LotFacts]) -> MassBalance:
    """Net what each account lost and gained over all entries.

    Lots are netted before masses are taken, so that what only passed through is not there. In
    REACTION what was consumed and made stays by lot: its sum is the residue.
    """
    nl: dict[str, dict[LotId, int]] = {}
    ug: dict[str, dict[LotId, int]] = {}
    for move in moves:
        for account, sign in ((move.debit, -1), (move.credit, 1)):
            for book, amount in ((nl, move.amount_nl), (ug, move.amount_ug)):
                held = book.setdefault(account, {})
                held[move.lot] = held.get(move.lot, 0) + sign * amount
    unknown: set[LotId] = set()
    changes = []
    for account in sorted(nl):
        masses: dict[LotId, int] = {}
        for lot in sorted({*nl[account], *ug[account]}):
            volume, mass = nl[account].get(lot, 0), ug[account].get(lot, 0)
            weighs = lots[lot].mass_ug(volume, mass)
            if weighs is None:
                unknown.add(lot)
            elif weighs:
                masses[lot] = weighs
        changes.append(AccountChange(account=account, lots_ug=masses))
    return MassBalance(
        taken=tuple(change for change in changes if change.total_ug < 0),
        brought=tuple(change for change in changes if change.total_ug > 0),
        unknown=tuple(sorted(unknown)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Yield:
    """What came of a chain of reactions, on the lot that limits the first of them."""

    product: LotId
    basis: LotId
    """The lot that was consumed first."""

    basis_umol: float | None
    isolated_ug: int | None
    isolated_umol: float | None
    missing: tuple[LotId, ...] = ()
    """Lots of which nobody stated density or concentration."""

    @property
    def ratio(self) -> float | None:
        """Return the yield, 1.0 for all of it; None: something is not stated."""
        if self.isolated_umol is None or not self.basis_umol:
            return None
        return self.isolated_umol / self.basis_umol


def find_yields(
    reactions: Collection[React],
    lots: Mapping[LotId, LotFacts],
    held: Mapping[LotId, tuple[int, int]],
) -> list[Yield]:
    """Reckon the yield of each product that no later reaction consumed.

    Args:
        reactions: Reactions of a run, in the order in which they went; those without a basis
            are left out.
        lots: What is stated of each lot.
        held: Nanolitres and micrograms of each product that stand in vessels now, waste aside.

    A reaction says that one mole of its basis gives at most one of its first product. A basis
    that is itself the product of an earlier reaction leads back to the basis of that.
    """
    based = [one for one in reactions if isinstance(one.basis, UUID)]
    made_by = {one.products[0].lot_id: one for one in based}
    consumed = {one.basis for one in based}
    found = []
    for reaction in based:
        product = reaction.products[0]
        if product.lot_id in consumed:
            continue
        first = reaction
        while isinstance(first.basis, UUID) and first.basis in made_by:
            first = made_by[first.basis]
        share = next(s for s in first.reactants if s.lot_id == first.basis)
        lot, basis = LotId(str(product.lot_id)), LotId(str(first.basis))
        nl, ug = held.get(lot, (0, 0))
        basis_umol = lots[basis].amount_umol(share.amount_nl, share.amount_ug)
        isolated_umol = lots[lot].amount_umol(nl, ug)
        unknown = ((basis, basis_umol), (lot, isolated_umol))
        found.append(
            Yield(
                product=lot,
                basis=basis,
                basis_umol=basis_umol,
                isolated_ug=lots[lot].mass_ug(nl, ug),
                isolated_umol=isolated_umol,
                missing=tuple(name for name, amount in unknown if amount is None),
            )
        )
    return found
