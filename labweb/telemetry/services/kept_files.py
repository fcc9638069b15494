"""Keep files by their digest, and make readings of those that a reader knows."""

from __future__ import annotations

import base64
import hashlib
import io
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any
from uuid import UUID

from django.conf import settings
from django.db import connection
from django.db.transaction import atomic

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common.clock import now
from labweb.common.limits.concurrency import give_back_connection
from labweb.domain.action_files import KEPT_ONLY, MEDIA_TYPES, is_name, plain_media_type
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import DefinitionError, StateError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Resource
from labweb.telemetry import selectors
from labweb.telemetry.models import File, Reading
from labweb.telemetry.services.instrument_file_reading import Made, read_instrument_file

MOST_BYTES = 256 * 2**20
"""Largest file that is kept; a larger one belongs in the archive of the instrument."""

PARQUET = "application/vnd.apache.parquet"
JPEG = "image/jpeg"
_BLOCK = 2**20
_STORE_LOCK = 0x6C62_66


@dataclass(frozen=True, slots=True)
class Upload:
    """What somebody brings."""

    stream: IO[bytes]
    name: str
    media_type: str
    format: str
    """A key of `MEDIA_TYPES`, or `none`: keep it and read nothing."""

    resource: Resource | None = None
    device: Device | None = None
    job_id: UUID | None = None


def subject_of(upload: Upload) -> dict[str, Any]:
    """Return what a file is about, as columns."""
    return {"resource": upload.resource, "device": upload.device, "job_id": upload.job_id}


def check_links(lab: Lab, resource: Resource | None, device: Device | None, actor: User) -> None:
    """See to it that a file has a subject, in one lab, on which the actor may work.

    Raises:
        DefinitionError: `file.no_subject`: neither a resource nor a device is named.
        ForbiddenError: The actor may not run anything there.
    """
    if resource is None and device is None:
        raise DefinitionError(
            "a file needs the resource that it is about, the device that it came from, or the job",
            code="file.no_subject",
        )
    if any(row is not None and row.lab_id != lab.pk for row in (resource, device)):
        raise DefinitionError("resource and device are of different labs", code="file.no_subject")
    if resource is not None:
        resource_selectors.require(actor, Permission.RUN, [resource.pk])
    if device is not None:
        resource_selectors.require(actor, Permission.RUN, enrollment_selectors.node_ids(device))


def keep_file(upload: Upload, *, lab: Lab, actor: User) -> File:
    """Keep a file, its series and its readings, or nothing of them.

    Raises:
        DefinitionError: It is too large or empty, its name or format cannot be, or its reader
            refuses it; findings name lines or fields. Nothing was written.
        ForbiddenError: The actor may not work there.
        StateError: `file.exists`: the same bytes were kept for the same subject before.

    Effect:
        None on matter. Writes bytes under the data directory, rows, and one line of audit.
    """
    name = check_upload(upload, lab, actor)
    with room() as folder:
        raw = folder / "raw"
        sha256 = received(upload.stream, raw)
        return read_and_keep(upload, name, raw, sha256, lab=lab, actor=actor)


def keep_picture(data: bytes, sha256: str, *, device: Device, job_id: UUID) -> None:
    """Keep a JPEG picture that a camera took for a job; one that is kept stays as it is.

    Effect:
        None on matter. Writes bytes under the data directory, a row, and one line of audit.
    """
    name = f"{device.key[:200]}.{sha256[:12]}.jpg"
    stream = io.BytesIO(data)
    upload = Upload(stream, name, JPEG, KEPT_ONLY, device=device, job_id=job_id)
    with room() as folder:
        raw = folder / "raw"
        received(stream, raw)
        try:
            read_and_keep(upload, name, raw, sha256, lab=device.lab, actor=None)
        except StateError as error:
            if error.code != "file.exists":
                raise


def check_upload(upload: Upload, lab: Lab, actor: User) -> str:
    """Check what can be known before a byte is read, and return the name to keep it under.

    Raises:
        DefinitionError: It has no subject, or its name or format cannot be.
        ForbiddenError: The actor may not work there.
    """
    check_links(lab, upload.resource, upload.device, actor)
    name = _name(upload.name)
    if upload.format not in {*MEDIA_TYPES, KEPT_ONLY}:
        known = ", ".join([*MEDIA_TYPES, KEPT_ONLY])
        raise DefinitionError(f"the format is one of {known}", code="file.format")
    return name


@contextmanager
def room() -> Iterator[Path]:
    """Give a folder beside the kept files, which is gone after."""
    root = Path(settings.DATA_DIR) / "files"
    root.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".incoming-", dir=root) as folder:
        yield Path(folder)


def read_and_keep(
    upload: Upload, name: str, raw: Path, sha256: str, *, lab: Lab, actor: User | None
) -> File:
    """Keep bytes that lie in a `room`, with their series and readings, or nothing of them.

    Raises:
        DefinitionError: The reader refuses them; findings name lines or fields.
        StateError: `file.exists`.
    """
    made = Made()
    if upload.format != KEPT_ONLY:
        made = read_instrument_file(upload.format, raw, raw.parent)
    with _placed([raw, *made.tables]):
        return _recorded(upload, name, sha256, made, lab=lab, actor=actor)


def _name(told: str) -> str:
    """Return the last part of a name, if it is one that can be shown and saved."""
    name = re.split(r"[/\\]", told)[-1].strip()
    if not is_name(name):
        raise DefinitionError("the file needs a name of 1 to 255 printable signs", code="file.name")
    return name


def received(stream: IO[bytes], target: Path, most_bytes: int | None = None) -> str:
    """Write a stream to disk block by block, and return the digest of its bytes.

    Raises:
        DefinitionError: `file.too_large`, `file.empty`.
    """
    most_bytes = MOST_BYTES if most_bytes is None else most_bytes
    give_back_connection()
    digest, size = hashlib.sha256(), 0
    with target.open("xb") as file:
        while block := stream.read(_BLOCK):
            size += len(block)
            if size > most_bytes:
                raise DefinitionError(
                    f"a file may have {most_bytes} bytes here",
                    code="file.too_large",
                    context={"most_bytes": most_bytes},
                )
            digest.update(block)
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
    if not size:
        raise DefinitionError("the file is empty", code="file.empty")
    return digest.hexdigest()


def move(path: Path, target: Path) -> None:
    """Give a file its place, which a power cut does not take once this has returned."""
    target.parent.mkdir(mode=0o700, exist_ok=True)
    path.rename(target)
    for folder in (target.parent, target.parent.parent):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def _placed(paths: list[Path]) -> Iterator[None]:
    """Put bytes where their digest says, and take back what is new when the record fails."""
    placed: list[Path] = []
    try:
        with atomic():
            _lock_store()
            for path in paths:
                target = selectors.path_of(digest_of(path))
                # Bytes that were damaged since are put right by whoever brings them again.
                if not target.exists() or digest_of(target) != target.name:
                    path.chmod(0o400)
                    placed.append(target)  # first: what cannot be made durable is taken back
                    move(path, target)
            yield
    except BaseException:
        with atomic():
            _lock_store()
            for target in placed:
                if not File.objects.filter(sha256=target.name).exists():
                    target.unlink(missing_ok=True)
        raise


def _lock_store() -> None:
    """Let one at a time add to the store, up to its commit."""
    with connection.cursor() as cursor:
        cursor.execute("SELECT pg_advisory_xact_lock(%s)", [_STORE_LOCK])


def _recorded(
    upload: Upload, name: str, sha256: str, made: Made, *, lab: Lab, actor: User | None
) -> File:
    links: dict[str, Any] = {
        "lab": lab,
        **subject_of(upload),
        "kept_at": now(),
    }
    check_new(upload, sha256, lab)
    row = File.objects.create(
        **links,
        sha256=sha256,
        size_bytes=selectors.path_of(sha256).stat().st_size,
        name=name,
        media_type=MEDIA_TYPES.get(upload.format, plain_media_type(upload.media_type)),
        format=upload.format,
        facts=made.facts,
        kept_by=actor,
    )
    series = [
        _series(row, digest, place, links, actor) for place, digest in enumerate(made.digests)
    ]
    Reading.objects.bulk_create(
        _reading(row, index, found, series, links) for index, found in enumerate(made.readings, 1)
    )
    account_services.write_audit(
        "file.keep",
        str(row.pk),
        actor=actor,
        detail={"sha256": sha256, "format": upload.format, "readings_count": len(made.readings)},
    )
    return row


def check_new(upload: Upload, sha256: str, lab: Lab) -> None:
    """See to it that the same bytes were not kept for the same subject before.

    Raises:
        StateError: `file.exists`; `context` names the file.
    """
    kept = File.objects.filter(sha256=sha256, made_from=None, lab=lab)
    before = kept.filter(**subject_of(upload)).first()
    if before is not None:
        raise StateError(
            f"the same bytes were kept as {before.name!r} already",
            code="file.exists",
            context={"file_id": str(before.pk), "sha256": sha256},
        )


def _series(row: File, digest: str, place: int, links: dict[str, Any], actor: User | None) -> File:
    return File.objects.create(
        **links,
        sha256=digest,
        size_bytes=selectors.path_of(digest).stat().st_size,
        name=f"{row.name[:230]}.{place + 1}.parquet",
        media_type=PARQUET,
        format="series",
        made_from=row,
        kept_by=actor,
    )


def _reading(
    row: File, index: int, found: dict[str, Any], series: list[File], links: dict[str, Any]
) -> Reading:
    at, place = found["measured_at"], found["table"]
    return Reading(
        **links,
        file=row,
        index=index,
        name=found["name"],
        quantity=found["quantity"],
        unit=found["unit"],
        value=found["value"],
        text=found["text"],
        series_file=None if place is None else series[place],
        series=found["series"],
        facts=found["facts"],
        measured_at=None if at is None else datetime.fromisoformat(at),
    )


def opened(row: File) -> IO[bytes]:
    """Open the bytes of a file, once they are known to be the ones that were kept.

    Raises:
        StateError: `file.damaged`: they are gone or not the same any more.
    """
    give_back_connection()
    # Returned open: whoever sends it closes it.
    return checked(row).open("rb")


def checked(row: File) -> Path:
    """Return where the bytes of a file lie, once they are known to be the ones that were kept.

    Raises:
        StateError: `file.damaged`: they are gone or not the same any more.
    """
    path = selectors.path_of(row.sha256)
    try:
        if digest_of(path) == row.sha256:
            return path
    except FileNotFoundError:
        pass
    raise StateError(
        f"the bytes of {row.name!r} are not those that were kept",
        code="file.damaged",
        context={"file_id": str(row.pk), "sha256": row.sha256},
    )


def digest_header(row: File) -> str:
    """Return a digest as HTTP writes it.

    Source:
        RFC 9530, `Repr-Digest`.
    """
    return f"sha-256=:{base64.b64encode(bytes.fromhex(row.sha256)).decode()}:"
