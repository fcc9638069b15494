"""Take in what hosts report: each event dated, written down, and given to whom it concerns."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from uuid import UUID

import msgspec
from django.db import DataError
from django.db.transaction import atomic

from labweb.common.clock import now, telling
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors.history_replay import begun_at
from labweb.domain.canonical_json import without_null
from labweb.domain.errors import LabError
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.host_link.host_clocks import Cause, Happened, happened, latest, told_moment
from labweb.domain.runs.host_link.host_session import check_events, heard
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import EdgeHost
from labweb.fleet.services import countersigned_heads, driver_replacement
from labweb.fleet.services.fencing import quarantine
from labweb.runs import selectors as run_selectors
from labweb.runs.selectors.events_of_hosts import Attempt
from labweb.runs.services import driver_switches, job_reports

logger = logging.getLogger(__name__)

_SENSELESS = (LabError, DataError, ValueError, KeyError, TypeError, AttributeError)
"""What comes of an event that says what cannot be."""


@atomic
def ingest_events(host_id: UUID, epoch: int, events: Sequence[EdgeEvent]) -> int | None:
    """Write down a frame of events and all they imply, in one transaction.

    Returns:
        The sequence number up to which the host may forget, or None when the session is
        over: another one took its place, or the log has a gap, a fork or an event of an
        action that cannot be. The last three quarantine the host, for what it has done is
        not known then; nothing of the frame is kept. An event that speaks of no action and
        makes no sense is kept, and a ticket says so.
    """
    host = enrollment_selectors.host_for_update(host_id)
    record = enrollment_services.record_of(host)
    if host.epoch != epoch or record.quarantine:
        return None
    intake = check_events(record, events)
    if intake.code:
        quarantine(host, intake.code, intake.message)
        return None
    at_s = now().timestamp()
    try:
        with atomic():
            for event, by_s in zip(intake.fresh, latest(intake.fresh, at_s), strict=True):
                _date(host, event, by_s)
            driver_switches.switch_idle(host)
    except _SENSELESS as error:
        quarantine(host, "host.bad_event", f"an event makes no sense: {error}")
        return None
    if intake.fresh:
        host.acked_seq = intake.fresh[-1].seq
        host.hash_at_acked = intake.fresh[-1].hash
        host.epoch_seen = heard(record).epoch_seen
        host.save(
            update_fields=[
                "acked_seq", "hash_at_acked", "epoch_seen", "acked_happened_s",
                "acked_uncertainty_s",
            ]
        )  # fmt: skip
    return host.acked_seq


def _date(host: EdgeHost, event: EdgeEvent, by_s: float) -> None:
    """Take an event in as of when it happened: after its dispatch and what was told before."""
    if host.acked_happened_s is None:
        causes = [Cause(begun_at(host.lab).timestamp())]
    else:
        causes = [Cause(host.acked_happened_s, host.acked_uncertainty_s)]
    attempt = None
    if event.action_id is not None:
        run_selectors.hold_run_of(event.action_id)
        attempt = run_selectors.attempt_for_update(event.action_id)
    if attempt is not None and attempt.host_id == host.id:
        causes.append(Cause(attempt.at.timestamp()))
    found = happened(told_moment(event), causes, by_s)
    host.acked_happened_s, host.acked_uncertainty_s = found.at_s, found.uncertainty_s
    with telling(found):
        _take(host, event, attempt, found)


def _take(host: EdgeHost, event: EdgeEvent, attempt: Attempt | None, found: Happened) -> None:
    if b"\\u0000" in msgspec.json.encode(event.body):
        event = msgspec.structs.replace(event, body=without_null(event.body))
    job_reports.keep_event(host, event, found)
    if event.action_id is not None:
        job_reports.take_report(host, event, attempt)
        return
    try:
        with atomic():
            _apply_word(host, event)
    except _SENSELESS as error:
        _doubt_word(host, event, str(error))


def _doubt_word(host: EdgeHost, event: EdgeEvent, why: str) -> None:
    """Ask a person to look at a word of a host that changed nothing; once for each kind of word."""
    logger.warning("event %d of %s, %s, makes no sense: %s", event.seq, host.name, event.kind, why)
    about = {"host_id": str(host.id), "kind": event.kind}
    known = crutd_selectors.open_tickets(host.lab).filter(code="host.bad_word")
    if not known.filter(detail__contains=about).exists():
        text = f"what {host.name} says of {event.kind} makes no sense, and changed nothing: {why}"
        detail = {**about, "seq": event.seq, "body": event.body}
        crutd_services.open_ticket(host.lab, "host.bad_word", text[:2000], detail)


def _apply_word(host: EdgeHost, event: EdgeEvent) -> None:
    """Apply what a host says of itself, of versions of drivers and of vessels on their way."""
    if event.kind in driver_replacement.KINDS:
        driver_replacement.take_driver_event(host, event)
    if event.kind in countersigned_heads.KINDS:
        countersigned_heads.take_head_event(host, event)
    job_reports.take_word(host, event)
