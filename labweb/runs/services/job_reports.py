"""Take in what a host reports of jobs, of vessels on their way and of halts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from uuid import UUID

import msgspec

from labweb.accounts import selectors as account_selectors
from labweb.common.clock import happened_at, moment_of, now
from labweb.common.render import iso
from labweb.crutd import services as crutd_services
from labweb.crutd.services import Settlement
from labweb.domain.calibration.corrected_reading import corrected
from labweb.domain.calibration.correction import Correction
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import StateError
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.halts.halted_setpoints import IS_HALTED
from labweb.domain.runs.halts.vanished_setpoints import EVENT as LOSS
from labweb.domain.runs.host_journal.surroundings import read_context
from labweb.domain.runs.host_link.host_clocks import Happened
from labweb.domain.runs.states.host_event_meaning import Meaning, read_event
from labweb.domain.runs.states.job_states import JobState, Mover
from labweb.enrollment.selectors import EdgeHost
from labweb.runs.models import Attempt, HostEvent, Outbox
from labweb.runs.services.action_files import await_files
from labweb.runs.services.execution import dispatch
from labweb.runs.services.execution.custody import KINDS, take_custody_event
from labweb.runs.services.execution.host_batches import settle_batch
from labweb.runs.services.execution.job_states import move_job, refresh_run
from labweb.runs.services.execution.transport_jobs import hand_on
from labweb.runs.services.fault_recovery.doubt_resolution import follow
from labweb.runs.services.host_tickets import doubt
from labweb.runs.services.stopping import abort
from labweb.runs.services.stopping.device_halts import take_halt, take_lost, undo_job


def keep_event(host: EdgeHost, event: EdgeEvent, found: Happened) -> None:
    """Write down an event as it was told, with the time at which it happened.

    Raises:
        StateError: The host has no session yet.
    """
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
        mono_s=event.mono_s,
        boot_id=event.boot_id,
        happened_at=moment_of(found),
        uncertainty_s=found.uncertainty_s,
        is_bounded=found.is_bounded,
        received_at=now(),
        body=event.body,
    )


def take_word(host: EdgeHost, event: EdgeEvent) -> None:
    """Apply what a host says of no action: of a stop, of vessels on their way and of halts."""
    if event.kind == "stop_reset":
        Outbox.objects.filter(
            host=host,
            kind="reset",
            body__stop_id=event.body.get("stop_id"),
            settled_at__isnull=True,
        ).update(settled_at=now())
    if event.kind in KINDS:
        take_custody_event(host, event)
    if event.kind == "halted":
        take_halt(host, event)
        abort.note_delivered(host, event)
    if event.kind in abort.HALT_KINDS:
        abort.take_halt_word(host, event)
    if event.kind == LOSS:
        take_lost(host, event)


def take_report(host: EdgeHost, event: EdgeEvent, attempt: Attempt | None) -> None:
    """Apply what a host says of an action: to its job, its transaction and the ledger.

    Args:
        host: Which.
        event: What it says.
        attempt: The action, locked with its job; None: this server knows of none.
    """
    if attempt is None or attempt.host_id != host.id:
        text = f"{host.name} reports on an action this server never sent it"
        detail = {"action_id": str(event.action_id), "kind": event.kind}
        doubt(host, "host.unknown_action", text, detail, "action_id")
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
        settle_batch(attempt)
        if meaning.state is JobState.COMPLETE and event.body.get(IS_HALTED) is True:
            undo_job(attempt.job)
        abort.go_on_aborting(attempt.job.run)
    refresh_run(attempt.job.run_id)
    if meaning.is_resolution:
        follow(attempt.job_id)


def _settle(attempt: Attempt, event: EdgeEvent, meaning: Meaning) -> None:
    outcome = meaning.outcome
    if outcome is None:
        return
    settlement = _settlement(event.body, outcome)
    if meaning.is_resolution:
        settlement = replace(settlement, resolution=_answer(event.body, meaning))
    if meaning.is_resolution and outcome.kind is OutcomeKind.UNKNOWN:
        crutd_services.discard(attempt.transaction_id, replace(settlement, keep_quarantined=True))
    else:
        change = crutd_services.settle(attempt.transaction_id, settlement)
        hand_on(attempt, change)
    if not meaning.is_resolution:
        await_files(attempt, event.body.get("report") or {})


def _fields(attempt: Attempt, event: EdgeEvent, meaning: Meaning) -> dict[str, Any]:
    """Return what else an event writes into the row of its job."""
    body, evidence = event.body, attempt.job.evidence
    if event.kind in {"started", "actuated"}:
        return {"evidence": evidence | _moment(event)}
    stands = {"halted_by": ""} if meaning.state is JobState.COMPLETE else {}
    if meaning.is_resolution:
        return {
            "evidence": {**evidence, "resolution": _resolution(attempt, body, meaning)},
            **stands,
        }
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
            "report": (report := body.get("report") or evidence.get("report", {})),
            **_corrected(attempt, report),
        },
        **stands,
    }


def _corrected(attempt: Attempt, report: Mapping[str, Any]) -> dict[str, Any]:
    """Return what was read as the calibration makes it, beside the raw readings."""
    known = msgspec.convert(attempt.job.corrections, list[Correction])
    found = corrected(known, report.get("evidence") or {}) if known else {}
    return {"corrected": found} if found else {}


def _moment(event: EdgeEvent) -> dict[str, Any]:
    """Return what a host says of the start of an action or of its device's answer."""
    found: dict[str, Any] = {}
    context = read_context(event.body.get("context"))
    if context is not None:
        found[f"{event.kind}_context"] = context
    if event.kind == "started":
        return found | {"pre": event.body.get("pre", [])}
    return found | {"report": event.body.get("report") or {}}


def _answer(body: Mapping[str, Any], meaning: Meaning) -> dict[str, Any]:
    """Return what a person answered about a doubt, as their host was told it."""
    answer = {
        "answer": body.get("answer"),
        "note": body.get("note"),
        "by_id": body.get("issued_by"),
    }
    if body.get("answer") == "partly" and meaning.outcome is not None:
        answer["moved_nl"] = meaning.outcome.moved_nl
    if body.get("despite_reading"):
        answer["despite_reading"] = str(body["despite_reading"])
    return answer


def _resolution(attempt: Attempt, body: Mapping[str, Any], meaning: Meaning) -> dict[str, Any]:
    """Return the answer with its person and both times: of the doubt and of its end."""
    return {
        **_answer(body, meaning),
        "by": _name_of(str(body.get("issued_by") or "")),
        "doubt_at": iso(attempt.job.ended_at or attempt.job.state_at),
        "at": iso(happened_at()),
    }


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
