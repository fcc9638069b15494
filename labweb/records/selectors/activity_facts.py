"""What stands behind transactions: jobs, runs, decisions, devices, people, as facts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any
from uuid import UUID

from labweb.accounts import selectors as account_selectors
from labweb.approvals import selectors as approval_selectors
from labweb.common.render import iso
from labweb.domain.crutd.provenance.recorded_facts import DecisionFact, DeviceFact, JobFact, RunFact
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources.selectors import Lab
from labweb.runs.selectors import Attempt, Job, Outbox, Run


def job_facts(jobs: Iterable[Job]) -> list[JobFact]:
    """Return jobs with the newest try of each and the driver that it was sent to; two queries.

    The digest is the one that the command named, and not the one the device has by now.
    """
    rows = list(jobs)
    tries: dict[UUID, Attempt] = {
        row.job_id: row
        for row in Attempt.objects.filter(job__in=[job.pk for job in rows]).order_by("number")
    }
    sent = Outbox.objects.filter(action_id__in=[row.pk for row in tries.values()], kind="do")
    digests: dict[UUID, str] = dict(sent.values_list("action_id", "body__driver_digest"))
    return [_job(job, tries.get(job.pk), digests) for job in rows]


def _job(job: Job, attempt: Attempt | None, digests: dict[UUID, str]) -> JobFact:
    evidence: dict[str, Any] = job.evidence
    resolution = evidence.get("resolution") or {}
    return JobFact(
        id=str(job.pk),
        run_id=str(job.run_id),
        index=job.index,
        sentence=job.sentence,
        action=job.action,
        state=job.state,
        device_id=str(job.device_id),
        host_id="" if attempt is None else str(attempt.host_id),
        driver_digest="" if attempt is None else digests.get(attempt.pk) or "",
        verification=job.verification,
        started_at=iso(job.started_at) or "",
        ended_at=iso(job.ended_at) or "",
        worker_pid=None if attempt is None else attempt.worker_pid,
        report=evidence.get("report") or {},
        contexts={
            moment: evidence[f"{moment}_context"]
            for moment in ("started", "actuated")
            if f"{moment}_context" in evidence
        },
        resolved_by=str(resolution.get("by_id") or ""),
    )


def run_facts(ids: Collection[str]) -> list[RunFact]:
    """Return runs with the versions they carry out."""
    rows = Run.objects.filter(pk__in=list(ids)).select_related("version__workflow")
    return [
        RunFact(
            id=str(row.pk),
            number=row.number,
            state=row.state,
            workflow=row.version.workflow.name,
            version_id=str(row.version_id),
            version_number=row.version.number,
            version_digest=row.version.digest,
            version_author_id=str(row.version.author_id or ""),
            version_at=iso(row.version.at) or "",
            plan_digest=row.plan_digest,
            created_by_id=str(row.created_by_id),
            started_at=iso(row.started_at) or "",
            ended_at=iso(row.ended_at) or "",
        )
        for row in rows
    ]


def decision_facts(lab: Lab, run_ids: Collection[str]) -> list[DecisionFact]:
    """Return the decisions about runs."""
    asked = approval_selectors.requests_of(lab).filter(run_id__in=list(run_ids))
    return [
        DecisionFact(
            id=str(request.decision.pk),
            run_id=str(request.run_id),
            actor_id=str(request.decision.actor_id),
            meaning=request.decision.meaning,
            is_approved=request.decision.is_approved,
            at=iso(request.decision.at) or "",
        )
        for request in asked
        if getattr(request, "decision", None) is not None
    ]


def device_facts(lab: Lab, ids: Collection[str]) -> list[DeviceFact]:
    """Return devices with their hosts."""
    rows = enrollment_selectors.devices_of(lab).filter(pk__in=list(ids))
    return [
        DeviceFact(
            id=str(row.pk),
            name=row.name,
            host_id=str(row.host_id),
            nodes=tuple(str(node) for node in row.nodes.values()),
        )
        for row in rows
    ]


def host_names(lab: Lab) -> dict[str, str]:
    """Return name by id of every host."""
    return {str(row.pk): row.name for row in enrollment_selectors.hosts_of(lab)}


def people(ids: Iterable[str]) -> dict[str, str]:
    """Return printed names by id."""
    return account_selectors.printed_names(sorted({i for i in ids if i}))


def drivers(jobs: Sequence[JobFact]) -> dict[str, str]:
    """Return the class by digest of every driver that did one of the jobs."""
    return enrollment_selectors.driver_names({job.driver_digest for job in jobs})
