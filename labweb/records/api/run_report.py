"""The report of a run: mass balance, yields, and the spectra of its products."""

from __future__ import annotations

from collections.abc import Mapping
from uuid import UUID

from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.answers import NamedRef
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.mass_balance import AccountChange, Yield
from labweb.domain.crutd.provenance.ledger_flows import is_nominal
from labweb.domain.resources.contents_by_lot import LotId
from labweb.records.answers.run_report import (
    LotMass,
    MassAccount,
    ProductYield,
    RunDoubt,
    RunReport,
    UnconfirmedJob,
)
from labweb.records.api.files import render_reading
from labweb.records.selectors.run_report import RunFacts, report_of
from labweb.resources import selectors as resource_selectors
from labweb.runs.api.runs import visible


class ReportOfRun(Endpoint):
    """What a run did with matter."""

    def get(self, request: Request, run_id: UUID) -> RunReport:
        """Return masses by account, yields by product, and readings that are series.

        Nothing in it was entered: masses follow from the ledger's entries and the densities of
        the materials, a yield from a reaction's basis and from what of its product stands in
        vessels now, the waste aside.
        """
        user = user_of(request)
        run = visible(run_id, user)
        seen = resource_selectors.allowed_ids(user, Permission.VIEW)
        report = report_of(run, seen)
        balance = report.balance
        ids = {UUID(c.account) for c in _all(report) if not is_nominal(c.account)}
        ids |= {vessel for places in report.standing.values() for vessel in places}
        names = {row.pk: row.name for row in resource_selectors.rows(ids & seen)}
        return RunReport(
            started_at=run.started_at,
            ended_at=run.ended_at,
            taken=[_change(change, report, names) for change in balance.taken],
            brought=[_change(change, report, names) for change in balance.brought],
            taken_ug=balance.taken_ug,
            brought_ug=balance.brought_ug,
            gap_ug=balance.gap_ug,
            unknown=[str(report.lots[lot]) for lot in balance.unknown],
            yields=[_yield(one, report, names) for one in report.yields],
            readings=[render_reading(row) for row in report.spectra],
            doubts=[
                RunDoubt(
                    job_id=job.pk,
                    sentence=job.sentence,
                    resolved=None if end is None else end.told(),
                )
                for job, end in report.doubts
            ],
            unconfirmed=[
                UnconfirmedJob(job_id=job.pk, sentence=job.sentence, message=job.message)
                for job in report.unconfirmed
            ],
        )


def _all(report: RunFacts) -> tuple[AccountChange, ...]:
    return (*report.balance.taken, *report.balance.brought)


def _change(change: AccountChange, report: RunFacts, names: Mapping[UUID, str]) -> MassAccount:
    nominal = is_nominal(change.account)
    vessel = None if nominal else UUID(change.account)
    return MassAccount(
        account=change.account if nominal else "vessel",
        resource_id=vessel if vessel in names else None,
        name=change.account if vessel is None else names.get(vessel, ""),
        mass_ug=change.total_ug,
        lots=[
            LotMass(lot=str(report.lots[lot]), mass_ug=mass)
            for lot, mass in sorted(change.lots_ug.items(), key=lambda one: -abs(one[1]))
        ],
    )


def _yield(one: Yield, report: RunFacts, names: Mapping[UUID, str]) -> ProductYield:
    def name(lot: LotId) -> str:
        return str(report.lots[lot])

    return ProductYield(
        product=name(one.product),
        product_id=UUID(one.product),
        material=report.lots[one.product].material.name,
        basis=name(one.basis),
        basis_umol=one.basis_umol,
        isolated_ug=one.isolated_ug,
        isolated_umol=one.isolated_umol,
        ratio=one.ratio,
        missing=[name(lot) for lot in one.missing],
        stands_in=[
            NamedRef(id=vessel, name=names[vessel])
            for vessel in sorted(report.standing.get(one.product, {}))
            if vessel in names
        ],
    )
