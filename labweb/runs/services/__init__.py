"""Writes of runs: start, dispatch, take in what hosts report, control."""

from __future__ import annotations

from labweb.runs.services.control import (
    abort_run,
    pause_run,
    reset_lab,
    resolve_job,
    resume_run,
    stop_lab,
)
from labweb.runs.services.custody import begin_transfer, confirm_arrival, hand_over
from labweb.runs.services.dispatch import publish_outbox
from labweb.runs.services.expiry import expire_requests
from labweb.runs.services.fencing import (
    fence_host,
    note_quarantine,
    note_rival,
    revoke_host,
)
from labweb.runs.services.ingest import ingest_events
from labweb.runs.services.isolation import isolate_hosts
from labweb.runs.services.recovery import recover_job
from labweb.runs.services.schedule import dispatch_ready
from labweb.runs.services.start import (
    check_named,
    decide_request,
    names_for,
    preview,
    start_run,
    touched,
)

__all__ = [
    "abort_run",
    "begin_transfer",
    "check_named",
    "confirm_arrival",
    "decide_request",
    "dispatch_ready",
    "expire_requests",
    "fence_host",
    "hand_over",
    "ingest_events",
    "isolate_hosts",
    "names_for",
    "note_quarantine",
    "note_rival",
    "pause_run",
    "preview",
    "publish_outbox",
    "recover_job",
    "reset_lab",
    "resolve_job",
    "resume_run",
    "revoke_host",
    "start_run",
    "stop_lab",
    "touched",
]
