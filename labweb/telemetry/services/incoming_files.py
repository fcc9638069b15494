"""Files that wait: named by an action or brought in a request, read by the server's own worker.

The row is the queue of record, and the message to the worker a doorbell: one that is lost is
rung again, one that comes twice finds nothing to do.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from datetime import timedelta
from functools import partial
from pathlib import Path
from uuid import UUID

from django.conf import settings
from django.db.models import QuerySet
from django.db.transaction import atomic, on_commit

from labweb.accounts.selectors import User
from labweb.common import feed, queue
from labweb.common.clock import now
from labweb.domain.action_files import KEPT_ONLY, LOST, NamedFile
from labweb.domain.errors import DefinitionError, LabError, StateError
from labweb.enrollment.selectors import Device
from labweb.resources.selectors import Lab, Resource
from labweb.telemetry.models import File, Incoming
from labweb.telemetry.services.kept_files import (
    Upload,
    check_new,
    check_upload,
    digest_of,
    move,
    read_and_keep,
    received,
    room,
    subject_of,
)

READ_TASK = "telemetry.read_file"
RING_AGAIN_AFTER = timedelta(seconds=10)
MOST_TRIES = 3
"""A file at which the worker itself ended so often is refused."""


def bring(upload: Upload, *, lab: Lab, actor: User) -> Incoming:
    """Take the bytes of a file in, and have them read; nothing of them is read here.

    Raises:
        DefinitionError: It is too large or empty, or its subject, name or format cannot be.
        ForbiddenError: The actor may not work there.
        StateError: `file.exists`, `file.being_read`: the same bytes for the same subject are
            kept, or wait to be.

    Effect:
        None on matter. Writes bytes under the data directory and one row.
    """
    name = check_upload(upload, lab, actor)
    with room() as folder:
        raw = folder / "raw"
        sha256 = received(upload.stream, raw)
        check_new(upload, sha256, lab)
        _check_not_waiting(upload, sha256, lab)
        row = Incoming(
            lab=lab,
            sha256=sha256,
            size_bytes=raw.stat().st_size,
            name=name,
            format=upload.format,
            **subject_of(upload),
            brought_by=actor,
            brought_at=now(),
            asked_at=now(),
        )
        waiting = _path(row.pk)
        move(raw, waiting)
    try:
        with atomic():
            row.save(force_insert=True)
            on_commit(partial(queue.ask, READ_TASK, str(row.pk)))
    except BaseException:
        if not Incoming.objects.filter(pk=row.pk).exists():
            waiting.unlink(missing_ok=True)
        raise
    return row


def _check_not_waiting(upload: Upload, sha256: str, lab: Lab) -> None:
    waiting = Incoming.objects.filter(lab=lab, sha256=sha256, state=Incoming.State.PENDING)
    before = waiting.filter(**subject_of(upload)).first()
    if before is not None:
        raise StateError(
            f"the same bytes are being read as {before.name!r}",
            code="file.being_read",
            context={"incoming_id": str(before.pk), "sha256": sha256},
        )


def _path(incoming_id: UUID) -> Path:
    return Path(settings.DATA_DIR) / "files" / ".waiting" / str(incoming_id)


def read_incoming(
    incoming_id: UUID, tell_lost: Callable[[Incoming], None] = lambda _row: None
) -> None:
    """Read a file that waits, and keep it with its readings, or write down why not.

    Its row stays locked while it is read, so that nobody reads it twice, and so that the end
    of this process, whatever it is, gives it free at once.

    Args:
        incoming_id: Which.
        tell_lost: Is told, in the same write, of what an action measured and is damaged here:
            its host has dropped it by then.
    """
    with atomic():
        row = _held(incoming_id)
        if row is None:
            return
        row.tries += 1
        row.save(update_fields=["tries"])
    with atomic():
        row = _held(incoming_id)
        if row is None:
            return
        try:
            with atomic():
                row.file = _read(row)
            row.state = Incoming.State.PARSED
        except (DefinitionError, StateError) as error:
            _refuse(row, error)
            if row.action_id is not None:
                _keep_refused(row, error)
            if row.state == Incoming.State.LOST:
                tell_lost(row)
        row.ended_at = now()
        row.save()
        on_commit(partial(_path(row.pk).unlink, missing_ok=True))
        if row.action_id is not None and row.job is not None:
            body = {"run_id": str(row.job.run_id), "job_id": str(row.job.pk)}
            on_commit(partial(feed.publish, f"run:{row.job.run_id}", body))


def _held(incoming_id: UUID) -> Incoming | None:
    rows = Incoming.objects.filter(pk=incoming_id, state=Incoming.State.PENDING)
    return rows.select_for_update(skip_locked=True, no_key=True).first()


def _refuse(row: Incoming, error: LabError) -> None:
    row.state = Incoming.State.REFUSED
    row.file = None
    row.code, row.message = error.code, error.message
    row.findings = [finding.to_json() for finding in error.findings]


def _read(row: Incoming) -> File:
    if row.tries > MOST_TRIES:
        raise DefinitionError(
            f"the worker ended {MOST_TRIES} times while it read this file",
            code="instrument.unreadable",
        )
    return _kept(row, row.format)


def _keep_refused(row: Incoming, error: LabError) -> None:
    """Keep what an action measured though nothing of it can be read."""
    if error.code == "file.damaged":
        _lose(row)
        return
    try:
        if error.code == "file.exists":
            raise error
        with atomic():
            row.file = _kept(row, KEPT_ONLY)
    except StateError as again:
        if again.code == "file.damaged":
            _lose(row)
            return
        if again.code != "file.exists":
            raise
        row.file = File.objects.get(pk=again.context["file_id"])
        if error.code == "file.exists":
            row.state, row.code, row.message = Incoming.State.PARSED, "", ""


def _lose(row: Incoming) -> None:
    row.state, row.code = Incoming.State.LOST, "file.damaged"
    row.message = "its bytes were damaged on the server's disk, and its host has dropped them"


def _kept(row: Incoming, form: str) -> File:
    upload = Upload(
        stream=io.BytesIO(),
        name=row.name,
        media_type=row.media_type,
        format=form,
        resource=row.resource,
        device=row.device,
        job_id=row.job_id,
    )
    with room() as folder:
        raw = folder / "raw"
        try:
            # A second name, since what is kept is moved: should this fail, the first is there.
            os.link(_path(row.pk), raw)
        except FileNotFoundError as error:
            raise _lost(row) from error
        if digest_of(raw) != row.sha256:
            raise _lost(row)
        return read_and_keep(upload, row.name, raw, row.sha256, lab=row.lab, actor=row.brought_by)


def _lost(row: Incoming) -> StateError:
    return StateError(
        f"the bytes of {row.name!r} are not those that were brought: bring them again",
        code="file.damaged",
        context={"sha256": row.sha256},
    )


def ring_incoming() -> int:
    """Ask again for files of which a worker has not been heard; those being read are locked.

    Returns:
        How many were asked for.
    """
    due = Incoming.objects.filter(
        state=Incoming.State.PENDING, asked_at__lt=now() - RING_AGAIN_AFTER
    )
    with atomic():
        rows = list(due.select_for_update(skip_locked=True, no_key=True).order_by("id")[:100])
        Incoming.objects.filter(pk__in=[row.pk for row in rows]).update(asked_at=now())
    for row in rows:
        queue.ask(READ_TASK, str(row.pk))
    return len(rows)


def await_file(
    told: NamedFile,
    *,
    device: Device,
    resource: Resource | None,
    job_id: UUID,
    action_id: UUID,
) -> None:
    """Write down that an action of a host has measured a file, whose bytes are to come.

    Effect:
        None on matter. Writes one row; the file counts as missing until its bytes are here.
    """
    Incoming.objects.get_or_create(
        action_id=action_id,
        sha256=told.sha256,
        defaults={
            "lab": device.lab,
            "size_bytes": told.size_bytes,
            "name": told.name,
            "format": told.format,
            "media_type": told.media_type,
            "resource": resource,
            "device": device,
            "job_id": job_id,
            "brought_at": now(),
            "asked_at": now(),
            "state": Incoming.State.AWAITED,
        },
    )


def arrive(action_id: UUID, sha256: str, data: bytes) -> bool:
    """Take the bytes of an awaited file in, and have them read; False: they are not those.

    Effect:
        None on matter. Writes bytes under the data directory; they are on disk before the
        row says that they came.
    """
    row = _missing().filter(action_id=action_id, sha256=sha256).first()
    if row is None or len(data) != row.size_bytes:
        return False
    with room() as folder:
        raw = folder / "raw"
        if received(io.BytesIO(data), raw) != sha256:
            return False
        move(raw, _path(row.pk))
    with atomic():
        _missing().filter(pk=row.pk).update(
            state=Incoming.State.PENDING, asked_at=now(), ended_at=None, code="", message=""
        )
        on_commit(partial(queue.ask, READ_TASK, str(row.pk)))
    return True


def note_lost(action_id: UUID, sha256: str, message: str) -> Incoming | None:
    """Write down that a host does not have an awaited file any more; None: it is not awaited."""
    with atomic():
        rows = Incoming.objects.filter(
            action_id=action_id, sha256=sha256, state=Incoming.State.AWAITED
        )
        row = rows.select_for_update(no_key=True).first()
        if row is None:
            return None
        row.state, row.code, row.message = Incoming.State.LOST, LOST, message
        row.ended_at = now()
        row.save()
        return row


def _missing() -> QuerySet[Incoming]:
    return Incoming.objects.filter(state__in=[Incoming.State.AWAITED, Incoming.State.LOST])
