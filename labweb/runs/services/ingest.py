"""Take in what hosts report: events into job states, transactions and the ledger."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any
from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts import selectors as account_selectors
from labweb.common.clock import now
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.crutd.services import Settlement
from labweb.domain.crutd.decide import Outcome, OutcomeKind
from labweb.domain.errors import LabError, StateError
from labweb.domain.messages import EdgeEvent
from labweb.domain.runs.context import read_context
from labweb.domain.runs.intake import Meaning, read_event
from labweb.domain.runs.job import JobState, Mover
from labweb.domain.runs.session import SessionState, check_events
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import EdgeHost
from labweb.runs import selectors
from labweb.runs.models import Attempt, HostEvent, Outbox
from labweb.runs.services import dispatch
from labweb.runs.services.state import move_job, refresh_run

logger = logging.getLogger(__name__)


@atomic
def ingest_events(host_id: UUID, epoch: int, events: Sequence[EdgeEvent]) -> int | None:
    """Write down a frame of events and all they imply, in one transaction.

    Returns:
        The sequence number up to which the host may forget, or None when the session is
        over: another one took its place, or the log has a gap, a fork or an event that
        cannot be. The last three quarantine the host; nothing of the frame is kept.
    """
    host = enrollment_selectors.host_for_update(host_id)
    if host.epoch != epoch or host.state == SessionState.QUARANTINED.value:
        return None
    intake = check_events(enrollment_services.record_of(host), events)
    if intake.code:
        _quarantine(host, intake.code, intake.message)
        return None
    try:
        with atomic():
            for event in intake.fresh:
                _keep(host, event)
                _apply(host, event)
    except (LabError, ValueError, KeyError, TypeError, AttributeError) as error:
        _quarantine(host, "host.bad_event", f"an event makes no sense: {error}")
        return None
    if intake.fresh:
        host.acked_seq = intake.fresh[-1].seq
        host.hash_at_acked = intake.fresh[-1].hash
        host.save(update_fields=["acked_seq", "hash_at_acked"])
    return host.acked_seq


def _quarantine(host: EdgeHost, code: str, message: str) -> None:
    logger.error("host %s is quarantined: %s %s", host.name, code, message)
    enrollment_services.quarantine_host(host, code, message)
    crutd_services.open_ticket(host.lab, code, message, {"host_id": str(host.id)})
    _fence_jobs(host)


@atomic
def note_quarantine(host_id: UUID) -> None:
    """Put in doubt what a host was given whose journal does not continue the known one.

    Effect:
        None on matter. A person is asked to take stock; a host that is in quarantine
        already is not asked about again.
    """
    host = enrollment_selectors.host_for_update(host_id)
    code = str(host.heartbeat.get("code", "host.quarantined"))
    message = f"{host.name} is quarantined: {host.heartbeat.get('message', 'its journal differs')}"
    known = crutd_selectors.open_tickets(host.lab).filter(code=code, detail__host_id=str(host.id))
    if not known.exists():
        crutd_services.open_ticket(host.lab, code, message, {"host_id": str(host.id)})
    _fence_jobs(host)


def _fence_jobs(host: EdgeHost) -> None:
    """Put every dispatched job of a fenced host in doubt: its log can tell nothing of them."""
    Outbox.objects.filter(host=host, settled_at__isnull=True).update(settled_at=now())
    for job in selectors.jobs_at(host):
        attempt = selectors.last_attempt(job)
        if attempt is None:
            continue
        unknown = Settlement(outcome=Outcome(kind=OutcomeKind.UNKNOWN), code="host.quarantined")
        crutd_services.settle(attempt.transaction_id, unknown)
        move_job(
            job,
            JobState.IN_DOUBT,
            Mover.FENCE,
            code="host.quarantined",
            message=f"{host.name} is quarantined: nobody knows what became of this",
        )
        refresh_run(job.run_id)


def _keep(host: EdgeHost, event: EdgeEvent) -> None:
    if host.journal_id is None:
        raise StateError("events before HELLO", code="host.no_session")
    HostEvent.objects.create(
        host=host,
        journal_id=host.journal_id,
        seq=event.seq,
        hash=event.hash,
        kind=event.kind,
        action_id=event.action_id,
        at_s=event.at_s,
        received_at=now(),
        body=event.body,
    )


def _apply(host: EdgeHost, event: EdgeEvent) -> None:
    if event.kind == "stop_reset":
        Outbox.objects.filter(
            host=host,
            kind="reset",
            body__stop_id=event.body.get("stop_id"),
            settled_at__isnull=True,
        ).update(settled_at=now())
    if event.action_id is None:
        return
    selectors.hold_run_of(event.action_id)
    attempt = selectors.attempt_for_update(event.action_id)
    if attempt is None or attempt.host_id != host.id:
        crutd_services.open_ticket(
            host.lab,
            "host.unknown_action",
            f"{host.name} reports on an action this server never sent it",
            {"host_id": str(host.id), "action_id": str(event.action_id), "kind": event.kind},
        )
        return
    meaning = read_event(event.kind, event.body, JobState(attempt.job.state))
    dispatch.settle_outbox(attempt.id, list(meaning.answered))
    if event.kind == "started":
        pid = event.body.get("pid")
        attempt.worker_pid = pid if isinstance(pid, int) else None
        attempt.save(update_fields=["worker_pid"])
    if meaning.advance is not None:
        crutd_services.advance(attempt.transaction_id, meaning.advance)
    if meaning.outcome is not None:
        _settle(attempt, event, meaning)
    if meaning.state is not None:
        move_job(attempt.job, meaning.state, Mover.EDGE, **_fields(attempt, event, meaning))
    refresh_run(attempt.job.run_id)


def _settle(attempt: Attempt, event: EdgeEvent, meaning: Meaning) -> None:
    outcome = meaning.outcome
    if outcome is None:
        return
    settlement = _settlement(event.body, outcome)
    if meaning.is_resolution and outcome.kind is OutcomeKind.UNKNOWN:
        crutd_services.discard(attempt.transaction_id, replace(settlement, keep_quarantined=True))
    else:
        crutd_services.settle(attempt.transaction_id, settlement)


def _fields(attempt: Attempt, event: EdgeEvent, meaning: Meaning) -> dict[str, Any]:
    """Return what else an event writes into the row of its job."""
    body, evidence = event.body, attempt.job.evidence
    if event.kind in {"started", "actuated"}:
        return {"evidence": evidence | _moment(event)}
    if meaning.is_resolution:
        return {"evidence": {**evidence, "resolution": _resolution(body, meaning)}}
    if meaning.outcome is None:
        return {}
    return {
        "code": str(body.get("code", "")),
        "message": str(body.get("message", "")),
        "verification": str(body.get("verification", "")),
        "evidence": {
            **evidence,
            "post": body.get("post", []),
            "pre": body.get("pre") or evidence.get("pre", []),
            "report": body.get("report") or evidence.get("report", {}),
        },
    }


def _moment(event: EdgeEvent) -> dict[str, Any]:
    """Return what a host says of the start of an action or of its device's answer."""
    found: dict[str, Any] = {}
    context = read_context(event.body.get("context"))
    if context is not None:
        found[f"{event.kind}_context"] = context
    if event.kind == "started":
        return found | {"pre": event.body.get("pre", [])}
    return found | {"report": event.body.get("report") or {}}


def _resolution(body: Mapping[str, Any], meaning: Meaning) -> dict[str, Any]:
    resolution = {
        "answer": body.get("answer"),
        "note": body.get("note"),
        "by": _name_of(str(body.get("issued_by") or "")),
        "by_id": body.get("issued_by"),
    }
    if body.get("answer") == "partly" and meaning.outcome is not None:
        resolution["moved_nl"] = meaning.outcome.moved_nl
    return resolution


def _name_of(user_id: str) -> str:
    return account_selectors.printed_names([user_id] if user_id else []).get(user_id, user_id)


def _settlement(body: Mapping[str, Any], outcome: Outcome) -> Settlement:
    return Settlement(
        outcome=outcome,
        verification=str(body.get("verification", "")),
        conditions=[*body.get("pre", []), *body.get("post", [])],
        code=str(body.get("code", "")),
        message=str(body.get("message", "")),
        reported_change=body.get("change"),
        revs={UUID(key): int(rev) for key, rev in (body.get("revs") or {}).items()},
    )
