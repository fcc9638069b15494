"""Take in what hosts report: events into job states, transactions and the ledger."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts import selectors as account_selectors
from labweb.common.clock import now
from labweb.crutd import services as crutd_services
from labweb.crutd.services import Settlement
from labweb.domain.crutd.decide import Outcome, OutcomeKind
from labweb.domain.crutd.lifecycle import TransactionState
from labweb.domain.errors import LabError, StateError
from labweb.domain.messages import EdgeEvent
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
    if host.epoch != epoch:
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
    host.state = SessionState.QUARANTINED.value
    host.state_at = now()
    host.epoch += 1
    host.save(update_fields=["state", "state_at", "epoch"])
    crutd_services.open_ticket(host.lab, code, message, {"host_id": str(host.id)})


def note_quarantine(host_id: UUID) -> None:
    """Ask a person to take stock of a host whose journal does not continue the known one."""
    host = enrollment_selectors.find_host(host_id)
    if host is None:
        return
    code = str(host.heartbeat.get("code", "host.quarantined"))
    message = f"{host.name} is quarantined: {host.heartbeat.get('message', 'its journal differs')}"
    crutd_services.open_ticket(host.lab, code, message, {"host_id": str(host.id)})


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
    handler = _HANDLERS.get(event.kind)
    if handler is not None:
        handler(attempt, event)
        refresh_run(attempt.job.run_id)


def _on_accepted(attempt: Attempt, _event: EdgeEvent) -> None:
    dispatch.settle_outbox(attempt.id, ["do"])
    if attempt.job.state == JobState.DISPATCHED.value:
        move_job(attempt.job, JobState.ACCEPTED, Mover.EDGE)


def _on_started(attempt: Attempt, event: EdgeEvent) -> None:
    pid = event.body.get("pid")
    attempt.worker_pid = pid if isinstance(pid, int) else None
    attempt.save(update_fields=["worker_pid"])
    crutd_services.advance(attempt.transaction_id, TransactionState.EXECUTING)
    move_job(attempt.job, JobState.RUNNING, Mover.EDGE)


def _on_actuated(attempt: Attempt, event: EdgeEvent) -> None:
    crutd_services.advance(attempt.transaction_id, TransactionState.CONFIRMING)
    evidence = event.body.get("report") or {}
    move_job(attempt.job, JobState.COMPLETING, Mover.EDGE, evidence={"report": evidence})


def _on_ended(state: JobState) -> Callable[[Attempt, EdgeEvent], None]:
    def apply(attempt: Attempt, event: EdgeEvent) -> None:
        kinds = ["do", "cancel"] if state is JobState.IN_DOUBT else ["do", "cancel", "resolve"]
        dispatch.settle_outbox(attempt.id, kinds)
        body = event.body
        crutd_services.settle(attempt.transaction_id, _settlement(body, state))
        move_job(
            attempt.job,
            state,
            Mover.EDGE,
            code=str(body.get("code", "")),
            message=str(body.get("message", "")),
            verification=str(body.get("verification", "")),
            evidence={
                **attempt.job.evidence,
                "post": body.get("post", []),
                "pre": body.get("pre", []),
                "report": body.get("report") or attempt.job.evidence.get("report", {}),
            },
        )

    return apply


def _settlement(body: Mapping[str, Any], state: JobState) -> Settlement:
    return Settlement(
        outcome=_outcome(body.get("outcome"), state),
        verification=str(body.get("verification", "")),
        conditions=[*body.get("pre", []), *body.get("post", [])],
        code=str(body.get("code", "")),
        message=str(body.get("message", "")),
        reported_change=body.get("change"),
        revs={UUID(key): int(rev) for key, rev in (body.get("revs") or {}).items()},
    )


def _outcome(value: Mapping[str, Any] | None, state: JobState) -> Outcome:
    if value is None:
        unknown = state is JobState.IN_DOUBT
        kind = OutcomeKind.UNKNOWN if unknown else OutcomeKind.PARTIAL
        return Outcome(kind=kind, moved_nl=None if unknown else 0)
    moved = value.get("moved_nl")
    return Outcome(
        kind=OutcomeKind(value["kind"]),
        moved_nl=None if moved is None else int(moved),
        data=value.get("data") or {},
    )


def _on_resolved(attempt: Attempt, event: EdgeEvent) -> None:
    dispatch.settle_outbox(attempt.id, ["resolve"])
    body = event.body
    state = JobState(str(body["state"]))
    settlement = _settlement(body, state)
    if settlement.outcome.kind is OutcomeKind.UNKNOWN:
        crutd_services.discard(attempt.transaction_id, _kept(settlement))
    else:
        crutd_services.settle(attempt.transaction_id, settlement)
    resolution = {
        "answer": body.get("answer"),
        "note": body.get("note"),
        "by": _name_of(str(body.get("issued_by") or "")),
    }
    if body.get("answer") == "partly":
        resolution["moved_nl"] = settlement.outcome.moved_nl
    evidence = {**attempt.job.evidence, "resolution": resolution}
    move_job(attempt.job, state, Mover.EDGE, evidence=evidence)


def _name_of(user_id: str) -> str:
    return account_selectors.printed_names([user_id] if user_id else []).get(user_id, user_id)


def _kept(settlement: Settlement) -> Settlement:
    return Settlement(
        outcome=settlement.outcome,
        code=settlement.code,
        message=settlement.message,
        keep_quarantined=True,
    )


_HANDLERS: dict[str, Callable[[Attempt, EdgeEvent], None]] = {
    "accepted": _on_accepted,
    "started": _on_started,
    "actuated": _on_actuated,
    "complete": _on_ended(JobState.COMPLETE),
    "aborted": _on_ended(JobState.ABORTED),
    "in_doubt": _on_ended(JobState.IN_DOUBT),
    "rejected": _on_ended(JobState.REJECTED),
    "refused": _on_ended(JobState.REJECTED),
    "stopped": _on_ended(JobState.STOPPED),
    "resolved": _on_resolved,
}
