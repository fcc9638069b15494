"""What a run did with matter, read from the ledger: its mass balance, and what it yielded."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from uuid import UUID

from labweb.crutd import selectors as crutd_selectors
from labweb.crutd.selectors.doubt_resolutions import Resolved, resolved_of
from labweb.domain.crutd.ledger import Amount
from labweb.domain.crutd.mass_balance import LotFacts, MassBalance, Yield, find_yields, mass_balance
from labweb.domain.crutd.pre_and_postconditions import Verification
from labweb.domain.resources.contents_by_lot import LotId
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lot
from labweb.runs.selectors import Attempt, Job, Run
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry.selectors import Reading


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFacts:
    """A run's matter."""

    balance: MassBalance
    yields: tuple[Yield, ...]
    lots: dict[LotId, Lot]
    """Every lot that moved."""

    standing: dict[LotId, dict[UUID, Amount]]
    """Where the products stand now, the waste aside."""

    spectra: tuple[Reading, ...]
    """Series that were read from files about the run's jobs, or about a vessel with a product."""

    doubts: tuple[tuple[Job, Resolved | None], ...]
    """Each try that was in doubt with how that ended; None: it is still."""

    unconfirmed: tuple[Job, ...]
    """Actions that are complete, and whose confirmation could not be made."""


def report_of(run: Run, seen: Collection[UUID]) -> RunFacts:
    """Reckon the report of a run from its entries, as the ledger stands now.

    Args:
        run: Which.
        seen: Resources that the asker may know of; readings about others are left out.
    """
    jobs = {job.pk: job for job in run.jobs.order_by("index")}
    job_ids = list(jobs)
    moves = crutd_selectors.posted_by(job_ids)
    reactions = crutd_selectors.reactions_of(job_ids)
    products = {one.products[0].lot_id for one in reactions if isinstance(one.basis, UUID)}
    rows = resource_selectors.find_lots({move.lot for move in moves})
    lots = {LotId(str(row.pk)): row for row in rows}
    facts = {
        lot: LotFacts(
            key=row.key,
            density_mg_ul=row.material.density_mg_ul,
            concentration_mmol_l=row.material.concentration_mmol_l,
        )
        for lot, row in lots.items()
    }
    standing = crutd_selectors.standing(products)
    held = {
        lot: (sum(a.nl for a in places.values()), sum(a.ug for a in places.values()))
        for lot, places in standing.items()
    }
    yields = find_yields(reactions, facts, held)
    vessels = {vessel for one in yields for vessel in standing.get(one.product, {})}
    spectra = telemetry_selectors.series_about(job_ids, vessels & set(seen))
    return RunFacts(
        balance=mass_balance(moves, facts),
        yields=tuple(yields),
        lots=lots,
        standing=standing,
        spectra=tuple(spectra),
        doubts=_doubts(jobs),
        unconfirmed=tuple(
            job for job in jobs.values() if job.verification == Verification.UNCONFIRMED.value
        ),
    )


def _doubts(jobs: Mapping[UUID, Job]) -> tuple[tuple[Job, Resolved | None], ...]:
    rows = Attempt.objects.filter(job__in=list(jobs), transaction__events__state="quarantined")
    found = list(rows.distinct().order_by("dseq").values_list("job_id", "transaction_id"))
    ends = resolved_of(transaction for _, transaction in found)
    return tuple((jobs[job], ends.get(transaction)) for job, transaction in found)
