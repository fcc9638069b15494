"""Writes of runs: start, dispatch, take in what hosts report of jobs, control."""

from __future__ import annotations

from labweb.runs.services.aborting import abort_run, note_silence, stop_device
from labweb.runs.services.asking import asks_told, let_ask, take_ask, withdraw_ask
from labweb.runs.services.calibrating import (
    begin_calibration,
    decide_calibration,
    judge_ended,
    withdraw_calibration,
)
from labweb.runs.services.confirming import confirm_job
from labweb.runs.services.control import (
    pause_run,
    reset_lab,
    resume_run,
    stop_lab,
)
from labweb.runs.services.custody import begin_transfer, confirm_arrival, hand_over
from labweb.runs.services.dispatch import publish_outbox
from labweb.runs.services.expiry import expire_requests
from labweb.runs.services.failing import is_away, is_passing, tell_failing
from labweb.runs.services.files import files_asked, offer_file, read_file, take_file, take_gone
from labweb.runs.services.halting import why_taken
from labweb.runs.services.picture import lab_view
from labweb.runs.services.previewing import preview
from labweb.runs.services.recovery import recover_job
from labweb.runs.services.rehearsal import rehearse_dispatch, rehearse_start
from labweb.runs.services.rereading import reread_answers
from labweb.runs.services.reservations import end_reservation, reserve
from labweb.runs.services.resolving import Beside, resolve_job
from labweb.runs.services.schedule import dispatch_ready
from labweb.runs.services.showing import show_device
from labweb.runs.services.start import decide_request, start_run
from labweb.runs.services.state import announce

__all__ = [
    "Beside",
    "abort_run",
    "announce",
    "asks_told",
    "begin_calibration",
    "begin_transfer",
    "confirm_arrival",
    "confirm_job",
    "decide_calibration",
    "decide_request",
    "dispatch_ready",
    "end_reservation",
    "expire_requests",
    "files_asked",
    "hand_over",
    "is_away",
    "is_passing",
    "judge_ended",
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
    "withdraw_calibration",
]
