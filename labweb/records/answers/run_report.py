"""The report of a run."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from labweb.common.answers import ApiAnswer, NamedRef
from labweb.crutd.answers import DoubtEnd
from labweb.telemetry.answers import ReadingRow


class LotMass(ApiAnswer):
    """The mass of one lot in an account."""

    lot: str
    mass_ug: int


class MassAccount(ApiAnswer):
    """What a vessel or a nominal account lost or gained."""

    account: str
    """`vessel`, or a nominal account such as REACTION."""

    resource_id: UUID | None
    """Null: it is no vessel, or one that the caller may not know of."""

    name: str
    mass_ug: int
    """Negative where it left."""

    lots: list[LotMass]


class ProductYield(ApiAnswer):
    """What came of a chain of reactions, on the lot that limits the first of them."""

    product: str
    product_id: UUID
    material: str
    basis: str
    basis_umol: float | None
    isolated_ug: int | None
    isolated_umol: float | None
    ratio: float | None
    """1.0 for all of it; null: something is not stated, and `missing` names the lots."""

    missing: list[str]
    stands_in: list[NamedRef]


class RunDoubt(ApiAnswer):
    """A job that was in doubt, and how that ended."""

    job_id: UUID
    sentence: str
    resolved: DoubtEnd | None
    """Null: it is still open."""


class UnconfirmedJob(ApiAnswer):
    """A job that is complete, and whose confirmation could not be made."""

    job_id: UUID
    sentence: str
    message: str


class RunReport(ApiAnswer):
    """What a run did with matter."""

    started_at: datetime | None
    ended_at: datetime | None
    taken: list[MassAccount]
    brought: list[MassAccount]
    taken_ug: int
    brought_ug: int
    gap_ug: int
    """What arrived more than left: only the rounding of masses, when all is on record."""

    unknown: list[str]
    """Lots that moved and whose density nobody stated: they are in neither side."""

    yields: list[ProductYield]
    readings: list[ReadingRow]
    doubts: list[RunDoubt]
    unconfirmed: list[UnconfirmedJob]
