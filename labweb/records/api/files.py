"""The endpoints of files and of what was read from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar
from uuid import UUID

import msgspec
from django.http import HttpRequest, QueryDict, StreamingHttpResponse
from django.utils.http import content_disposition_header
from rest_framework.parsers import MultiPartParser
from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.common.answers import NamedRef, NumberedRef
from labweb.common.files.download import Blocks
from labweb.common.files.uploads import Bounded, one_file
from labweb.common.lists import HISTORY
from labweb.common.requests import Parameter, id_of, identity, whole_number
from labweb.crutd import api as crutd_api
from labweb.domain.action_files import KEPT_ONLY, MEDIA_TYPES
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import DefinitionError, Finding
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Resource
from labweb.runs import selectors
from labweb.runs.api.runs import visible_job
from labweb.runs.selectors import Job
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry import services as telemetry_services
from labweb.telemetry.answers import (
    DrawnSeries,
    FileDetail,
    FileJob,
    FileList,
    FileRow,
    FileState,
    IncomingList,
    IncomingRow,
    KeptFile,
    ReadingList,
    ReadingRow,
    ReadingSeries,
)
from labweb.telemetry.selectors import File, Incoming, Reading
from labweb.telemetry.services.kept_files import MOST_BYTES, digest_header, opened

_MOST_ROWS = 500
_MOST_POINTS = 10_000
_FIELDS = {"format", "resource", "device", "job"}
_ABOUT = {name: id_of(f"the {name}") for name in ("resource", "device", "job")}

_UPLOAD: dict[str, Any] = {
    "type": "object",
    "required": ["file", "format"],
    "additionalProperties": False,
    "properties": {
        "file": {"type": "string", "format": "binary"},
        "format": {"type": "string", "enum": [*MEDIA_TYPES, KEPT_ONLY]},
        **{name: {"type": "string", "format": "uuid"} for name in ("resource", "device", "job")},
    },
}


class Files(Endpoint):
    """Files of the lab."""

    parser_classes = [MultiPartParser]
    forms: ClassVar[dict[str, dict[str, Any]]] = {"post": _UPLOAD}
    answers: ClassVar = {"post": {201: FileDetail, 202: IncomingRow}}

    def initialize_request(
        self,
        request: HttpRequest,
        *args: Any,  # noqa: ANN401 - DRF's own shape
        **kwargs: Any,  # noqa: ANN401
    ) -> Request:
        """Bound the upload before the check of the session's token reads the form."""
        request.upload_handlers = [Bounded(request, MOST_BYTES)]
        return super().initialize_request(request, *args, **kwargs)

    queries: ClassVar[Mapping[str, Parameter]] = {
        **_ABOUT,
        "sha256": Parameter({"type": "string"}, "Of the bytes, in hexadecimal digits."),
        **HISTORY.parameters,
    }

    def get(self, request: Request) -> FileList:
        """List files, newest first; `resource`, `device`, `job` and `sha256` narrow it."""
        rows = telemetry_selectors.visible_files(resource_selectors.the_lab(), _seen(request))
        rows = rows.filter(made_from__isnull=True, **_narrowed(request))
        found, following = HISTORY.of_rows(request, rows, "-id")
        return FileList(files=file_rows(found, user_of(request)), next=following)

    def post(self, request: Request) -> Response:
        """Take a file in: a form with `file`, `format` and `resource`, `device` or `job`.

        One that is only kept is kept (201); one that is read waits for that (202), and
        `files/incoming/ID` says what became of it.
        """
        form, file = one_file(request, _FIELDS, MOST_BYTES)
        user = user_of(request)
        job = _job(form, user)
        upload = telemetry_services.Upload(
            stream=file,
            name=file.name or "",
            media_type=file.content_type or "",
            format=form.get("format", ""),
            resource=None
            if "resource" not in form
            else crutd_api.visible(request, _uuid(form, "resource")),
            device=_device(form, job, _seen(request)),
            job_id=None if job is None else job.pk,
        )
        lab = resource_selectors.the_lab()
        if upload.format == KEPT_ONLY:
            row = telemetry_services.keep_file(upload, lab=lab, actor=user)
            return Response(_detail(row, user), status=201)
        incoming = telemetry_services.bring(upload, lab=lab, actor=user)
        return Response(_incoming(incoming), status=202)


class IncomingFiles(Endpoint):
    """Files that were brought to be read."""

    queries: ClassVar[Mapping[str, Parameter]] = {**_ABOUT, **HISTORY.parameters}

    def get(self, request: Request) -> IncomingList:
        """List those that wait, were refused or are lost, newest first; `resource`… narrow it."""
        rows = telemetry_selectors.visible_incoming(resource_selectors.the_lab(), _seen(request))
        rows = rows.exclude(state=Incoming.State.PARSED).filter(**_narrowed(request))
        found, following = HISTORY.of_rows(request, rows, "-id")
        return IncomingList(incoming=[_incoming(row) for row in found], next=following)


class IncomingFile(Endpoint):
    """A file that was brought to be read."""

    def get(self, request: Request, incoming_id: UUID) -> IncomingRow:
        """Return whether it was read, and into which file, or why not."""
        lab = resource_selectors.the_lab()
        row = telemetry_selectors.find_incoming(lab, incoming_id, _seen(request))
        return _incoming(row)


class OneFile(Endpoint):
    """One file."""

    def get(self, request: Request, file_id: UUID) -> FileDetail:
        """Return a file with its readings and the series made from it."""
        return _detail(_find(request, file_id), user_of(request))


class FileContent(Endpoint):
    """The bytes of a file."""

    answer_type = "*/*"
    refusals: ClassVar = {"get": {409}}  # the bytes are not those that were kept

    def get(self, request: Request, file_id: UUID) -> StreamingHttpResponse:
        """Return the bytes as they were kept, with their checksum in `Repr-Digest`."""
        row = _find(request, file_id)
        answer = StreamingHttpResponse(Blocks(opened(row)), content_type=row.media_type)
        answer["Content-Length"] = str(row.size_bytes)
        answer["Content-Disposition"] = content_disposition_header(
            as_attachment=True, filename=row.name
        )
        answer["Repr-Digest"] = digest_header(row)
        answer["ETag"] = f'"{row.sha256}"'
        answer["Content-Security-Policy"] = "sandbox; default-src 'none'"
        return answer


class ReadingPoints(Endpoint):
    """The points of a series, for a plot."""

    refusals: ClassVar = {"get": {409}}  # as of the file
    queries: ClassVar[Mapping[str, Parameter]] = {
        "points": Parameter(
            {"type": "integer", "minimum": 2, "maximum": _MOST_POINTS}, "How many at most."
        ),
        "scan": Parameter({"type": "integer", "minimum": 0}, "Which of several spectra."),
    }

    def get(self, request: Request, reading_id: UUID) -> DrawnSeries:
        """Return at most `points` points; `scan` says which of several spectra."""
        lab = resource_selectors.the_lab()
        row = telemetry_selectors.find_reading(lab, reading_id, _seen(request))
        most = whole_number(request, "points", default=2000, low=2, high=_MOST_POINTS)
        is_told = "scan" in request.query_params
        scan = whole_number(request, "scan", default=0, low=0, high=2**31) if is_told else None
        return telemetry_services.drawn(row, scan=scan, most=most)


class Readings(Endpoint):
    """What was measured."""

    queries: ClassVar[Mapping[str, Parameter]] = {
        **_ABOUT,
        "file": id_of("the file that they were read from"),
        **HISTORY.parameters,
    }

    def get(self, request: Request) -> ReadingList:
        """List readings, newest file first; `resource`, `device`, `job` and `file` narrow it."""
        rows = telemetry_selectors.visible_readings(resource_selectors.the_lab(), _seen(request))
        rows = rows.filter(**_narrowed(request))
        found, following = HISTORY.of_rows(request, rows, "-file_id", "index")
        return ReadingList(readings=[render_reading(row) for row in found], next=following)


def _seen(request: Request) -> set[UUID]:
    return resource_selectors.allowed_ids(user_of(request), Permission.VIEW)


def _find(request: Request, file_id: UUID) -> File:
    lab = resource_selectors.the_lab()
    return telemetry_selectors.find_file(lab, file_id, _seen(request))


def _narrowed(request: Request) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in ("resource", "device", "job", "file"):
        if name in request.query_params:
            found[f"{name}_id"] = identity(request, name)
    if "sha256" in request.query_params:
        found["sha256"] = request.query_params["sha256"]
    return found


def _uuid(form: QueryDict, name: str) -> UUID:
    text = str(form[name])
    try:
        return UUID(text)
    except ValueError as error:
        raise DefinitionError(f"{name} is no id", code="http.query") from error


def _job(form: QueryDict, user: User) -> Job | None:
    if "job" not in form:
        return None
    return visible_job(_uuid(form, "job"), user)


def _device(form: QueryDict, job: Job | None, seen: set[UUID]) -> Device | None:
    """Return the device that is told; that of the job when there is one."""
    if "device" not in form:
        return None if job is None else job.device
    device = enrollment_selectors.find_device(_uuid(form, "device"), seen)
    if job is not None and job.device_id != device.pk:
        raise DefinitionError(
            f"the job ran on another device than {device.name}", code="file.other_device"
        )
    return device


def _detail(row: File, user: User) -> FileDetail:
    (told,) = file_rows([row], user)
    return FileDetail(
        **msgspec.structs.asdict(told),
        facts=row.facts,
        readings=[render_reading(reading) for reading in row.readings.all()[:_MOST_ROWS]],
        series=[kept_file(made) for made in row.made_files.order_by("id")],
        readings_count=row.readings.count(),
    )


def file_rows(rows: Sequence[File], user: User) -> list[FileRow]:
    """Say files with the names of what they are about, as far as the user may know of it."""
    lab = resource_selectors.the_lab()
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    devices: dict[UUID | None, Device] = {
        row.pk: row for row in enrollment_selectors.visible_devices(lab, seen)
    }
    ids = {row.resource_id for row in rows if row.resource_id is not None} & seen
    resources: dict[UUID | None, Resource] = {row.pk: row for row in resource_selectors.rows(ids)}
    wanted = {row.job_id for row in rows if row.job_id is not None}
    jobs: dict[UUID | None, Job] = {
        job.pk: job for job in selectors.jobs_with_runs(lab, seen, wanted)
    }
    return [
        FileRow(
            **msgspec.structs.asdict(kept_file(row)),
            resource=_named(resources.get(row.resource_id)),
            device=_named(devices.get(row.device_id)),
            job=_job_told(jobs.get(row.job_id)),
        )
        for row in rows
    ]


def _named(row: Resource | Device | None) -> NamedRef | None:
    return None if row is None else NamedRef(id=row.pk, name=row.name)


def _job_told(job: Job | None) -> FileJob | None:
    if job is None:
        return None
    run = NumberedRef(id=job.run_id, number=job.run.number)
    return FileJob(id=job.pk, index=job.index, sentence=job.sentence, run=run)


def _incoming(row: Incoming) -> IncomingRow:
    return IncomingRow(
        id=row.pk,
        name=row.name,
        format=row.format,
        size_bytes=row.size_bytes,
        sha256=row.sha256,
        state=msgspec.convert(str(row.state), FileState),
        file_id=row.file_id,
        code=row.code,
        message=row.message,
        findings=msgspec.convert(row.findings, list[Finding]),
        resource_id=row.resource_id,
        device_id=row.device_id,
        job_id=row.job_id,
        brought_by="" if row.brought_by is None else row.brought_by.printed_name,
        brought_at=row.brought_at,
        ended_at=row.ended_at,
    )


def kept_file(row: File) -> KeptFile:
    """Say a file without its bytes."""
    return KeptFile(
        id=row.pk,
        name=row.name,
        media_type=row.media_type,
        format=row.format,
        size_bytes=row.size_bytes,
        sha256=row.sha256,
        made_from_id=row.made_from_id,
        resource_id=row.resource_id,
        device_id=row.device_id,
        job_id=row.job_id,
        kept_by="" if row.kept_by is None else row.kept_by.printed_name,
        kept_at=row.kept_at,
    )


def render_reading(row: Reading) -> ReadingRow:
    """Say a reading; the values of a series are in its file."""
    return ReadingRow(
        id=row.pk,
        file_id=row.file_id,
        file_sha256=row.file.sha256,
        index=row.index,
        name=row.name,
        quantity=row.quantity,
        unit=row.unit,
        value=row.value,
        text=row.text,
        series_file_id=row.series_file_id,
        series=msgspec.convert(row.series, ReadingSeries | None),
        facts=row.facts,
        measured_at=row.measured_at,
        kept_at=row.kept_at,
        resource_id=row.resource_id,
        device_id=row.device_id,
        job_id=row.job_id,
    )
