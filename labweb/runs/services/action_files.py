"""Keep the files that actions of hosts hand over, and the pictures that verdicts rest on."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db.transaction import atomic, on_commit

from labweb.crutd import services as crutd_services
from labweb.domain.action_files import (
    UNKNOWN,
    WANTED,
    FileAsked,
    FileGone,
    FileOffer,
    FilePart,
    NamedFile,
    check_files,
    plain_media_type,
)
from labweb.domain.crutd.operations import from_json, sample_of
from labweb.domain.errors import DefinitionError, LabError, StateError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Resource
from labweb.runs.models import Attempt
from labweb.runs.services.execution.job_states import announce
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry import services as telemetry_services
from labweb.telemetry.selectors import Incoming

logger = logging.getLogger(__name__)

REFUSED = "file.refused"
JPEG_START = b"\xff\xd8\xff"
_MOST_ASKED = 200
_MISSING = {Incoming.State.AWAITED, Incoming.State.LOST}


def await_files(attempt: Attempt, report: Mapping[str, Any]) -> None:
    """Write down which files an action has measured, of which sample; their bytes come later.

    Raises:
        StateError: What the report names cannot be; nothing of its frame is written.
        msgspec.ValidationError: It is no list of files.

    Effect:
        None on matter. Until the bytes are here the record says that they are not.
    """
    told_files = msgspec.convert(report.get("files") or [], list[NamedFile])
    # A journal of an earlier release may hold a type that is none; the bytes are what they are.
    named = [
        msgspec.structs.replace(told, media_type=plain_media_type(told.media_type))
        for told in told_files
    ]
    findings = check_files(named)
    if findings:
        raise StateError(findings[0].message, code=findings[0].code)
    sample = _sample_of(attempt) if named else None
    for told in named:
        telemetry_services.await_file(
            told,
            device=attempt.job.device,
            resource=sample,
            job_id=attempt.job_id,
            action_id=attempt.pk,
        )


def _sample_of(attempt: Attempt) -> Resource | None:
    """Return the resource that an action measured; None: its operation does not say."""
    sample_id = sample_of(from_json(attempt.job.operation))
    return None if sample_id is None else resource_selectors.rows([sample_id]).first()


def offer_file(host_id: UUID, offer: FileOffer) -> str:
    """Say what a host is to do with a file that waits there.

    Returns:
        `WANTED`: send it; "": it is kept; `UNKNOWN`: no event names it yet; `file.refused`:
        it is of no action of this host.
    """
    attempt = _attempt(host_id, offer.action_id)
    if attempt is None:
        return REFUSED
    named = telemetry_selectors.named_by([attempt.pk]).filter(sha256=offer.sha256).first()
    if named is not None:
        return WANTED if named.state in _MISSING else ""
    if offer.sha256 not in _pictured(attempt.job.evidence):
        return UNKNOWN
    is_kept = telemetry_selectors.has_file(
        offer.sha256, device_id=offer.device_id, job_id=attempt.job_id
    )
    return "" if is_kept else WANTED


def take_file(host_id: UUID, part: FilePart, data: bytes) -> str:
    """Keep a file that came whole: of an action, to be read, or as the picture of a camera.

    Only what an event names is kept, under the digest that the event names.

    Returns:
        "" when it is kept, now or before; `UNKNOWN` when no event names it yet, and
        `file.refused` for what is not the file that is named.

    Effect:
        None on matter. Writes bytes under the data directory and rows.
    """
    attempt = _attempt(host_id, part.action_id)
    if attempt is None:
        return REFUSED
    named = telemetry_selectors.named_by([attempt.pk]).filter(sha256=part.sha256).first()
    if named is None:
        return _take_picture(host_id, attempt, part, data)
    if named.state not in _MISSING:
        return ""
    if not telemetry_services.arrive(attempt.pk, part.sha256, data):
        logger.warning("file %s of action %s is not the one named", part.sha256, attempt.pk)
        text = (
            f"its host sent {len(data)} bytes that are not those that the action named "
            f"({named.size_bytes} bytes), and has dropped them"
        )
        _lose(host_id, attempt, part.sha256, text)
        return REFUSED
    announce(attempt.job.run_id, attempt.job_id)
    return ""


def _take_picture(host_id: UUID, attempt: Attempt, part: FilePart, data: bytes) -> str:
    """Keep a picture as a file of its camera and of the job it is evidence in."""
    if part.sha256 not in _pictured(attempt.job.evidence):
        return UNKNOWN
    is_it = hashlib.sha256(data).hexdigest() == part.sha256 and data.startswith(JPEG_START)
    try:
        device = enrollment_selectors.find_device(part.device_id)
        if not is_it or device.host_id != host_id:
            raise DefinitionError("it is not the picture that is named")
        telemetry_services.keep_picture(data, part.sha256, device=device, job_id=attempt.job_id)
    except LabError as error:
        logger.warning("picture %s is not kept: %s", part.sha256, error)
        return REFUSED
    return ""


def files_asked(host_id: UUID) -> list[FileAsked]:
    """Return the files that a host has named and not sent, so that it can say whether it will."""
    rows = list(telemetry_selectors.awaited_files())
    own = Attempt.objects.filter(pk__in=[row.action_id for row in rows], host_id=host_id)
    actions = set(own.values_list("pk", flat=True))
    return [
        FileAsked(action_id=row.action_id, device_id=row.device_id, sha256=row.sha256)
        for row in rows
        if row.action_id in actions and row.device_id is not None
    ][:_MOST_ASKED]


def read_file(incoming_id: UUID) -> None:
    """Read a file that waits; one that is damaged here and was measured has a person look.

    Effect:
        None on matter. Writes the file with its readings, or why it is not read.
    """
    telemetry_services.read_incoming(incoming_id, _tell_damaged)


def _tell_damaged(row: Incoming) -> None:
    """Ask a person about a file that its host has dropped and this disk has spoilt."""
    rows = Attempt.objects.select_related("job__run")
    attempt = None if row.action_id is None else rows.filter(pk=row.action_id).first()
    if attempt is None:
        return
    crutd_services.open_ticket(
        row.lab,
        "file.damaged",
        f"{_named_in(row, attempt)} is lost: {row.message}. Look at the server's disk, and whether "
        "the instrument still has the file and bring it, or measure again.",
        _about(row, attempt),
    )


def _named_in(row: Incoming, attempt: Attempt) -> str:
    device = "" if row.device is None else f" of {row.device.name}"
    return f"{row.name}{device}, run #{attempt.job.run.number}, action {attempt.job.index + 1},"


def _about(row: Incoming, attempt: Attempt) -> dict[str, str]:
    job = attempt.job
    return {
        "host_id": str(attempt.host_id),
        "run_id": str(job.run_id),
        "job_id": str(job.pk),
        "device_id": str(job.device_id),
        "sha256": row.sha256,
    }


@atomic
def take_gone(host_id: UUID, gone: FileGone) -> None:
    """Write down that a file is lost, and have a person look; what is here already stays.

    Effect:
        None on matter: what the action did to it stands. Its measurement is not there.
    """
    attempt = _attempt(host_id, gone.action_id)
    if attempt is not None:
        _lose(host_id, attempt, gone.sha256, gone.message[:500])


@atomic
def _lose(host_id: UUID, attempt: Attempt, sha256: str, message: str) -> None:
    row = telemetry_services.note_lost(attempt.pk, sha256, message)
    if row is None:
        return
    crutd_services.open_ticket(
        row.lab,
        "file.lost",
        f"{_named_in(row, attempt)} is lost: {row.message}. Look whether the instrument still has "
        "it and bring it, or measure again.",
        {**_about(row, attempt), "host_id": str(host_id)},
    )
    on_commit(partial(announce, attempt.job.run_id, attempt.job_id))


def _attempt(host_id: UUID, action_id: UUID) -> Attempt | None:
    rows = Attempt.objects.filter(pk=action_id, host_id=host_id)
    return rows.select_related("job__run", "job__device__lab").first()


def _pictured(evidence: Any) -> Iterator[str]:  # noqa: ANN401 - any JSON
    """Yield the digests of pictures anywhere in the evidence of a job."""
    if isinstance(evidence, dict):
        found = evidence.get("image_sha256")
        if isinstance(found, str):
            yield found
        for part in evidence.values():
            yield from _pictured(part)
    elif isinstance(evidence, list):
        for part in evidence:
            yield from _pictured(part)
