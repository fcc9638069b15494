"""Writes of runs: start, dispatch, take in what hosts report of jobs, control."""

from __future__ import annotations

from labweb.runs.services.action_files import (
    files_asked,
    offer_file,
    read_file,
    take_file,
    take_gone,
)
from labweb.runs.services.approval_expiry import expire_requests
from labweb.runs.services.device_identification import show_device
from labweb.runs.services.execution.custody import begin_transfer, confirm_arrival, hand_over
from labweb.runs.services.execution.dispatch import publish_outbox
from labweb.runs.services.execution.failure_containment import is_away, is_passing, tell_failing
from labweb.runs.services.execution.job_states import announce
from labweb.runs.services.execution.scheduler_tick import dispatch_ready
from labweb.runs.services.fault_recovery.doubt_resolution import Beside, resolve_job
from labweb.runs.services.fault_recovery.readings_against_answers import reread_answers
from labweb.runs.services.fault_recovery.undone_jobs import recover_job
from labweb.runs.services.host_run_requests import asks_told, let_ask, take_ask, withdraw_ask
from labweb.runs.services.job_confirmation import confirm_job
from labweb.runs.services.planning.lab_view import lab_view
from labweb.runs.services.planning.preview import preview
from labweb.runs.services.planning.start import decide_request, start_run
from labweb.runs.services.planning.start_rehearsal import rehearse_dispatch, rehearse_start
from labweb.runs.services.reservations import end_reservation, reserve
from labweb.runs.services.stopping.abort import abort_run, note_silence, stop_device
from labweb.runs.services.stopping.device_halts import why_taken
from labweb.runs.services.stopping.pause_and_stop import (
    pause_run,
    reset_lab,
    resume_run,
    stop_lab,
)

__all__ = [
    "Beside",
    "abort_run",
    "announce",
    "asks_told",
    "begin_transfer",
    "confirm_arrival",
    "confirm_job",
    "decide_request",
    "dispatch_ready",
    "end_reservation",
    "expire_requests",
    "files_asked",
    "hand_over",
    "is_away",
    "is_passing",
    "lab_view",
    "let_ask",
    "note_silence",
    "offer_file",
    "pause_run",
    "preview",
    "publish_outbox",
    "read_file",
    "recover_job",
    "rehearse_dispatch",
    "rehearse_start",
    "reread_answers",
    "reserve",
    "reset_lab",
    "resolve_job",
    "resume_run",
    "show_device",
    "start_run",
    "stop_device",
    "stop_lab",
    "take_ask",
    "take_file",
    "take_gone",
    "tell_failing",
    "why_taken",
    "withdraw_ask",
]
