"""REST of samples, and of what they were rolled up into."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, ClassVar
from uuid import UUID

from django.http import HttpRequest, StreamingHttpResponse
from rest_framework.parsers import MultiPartParser
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.files.download import Blocks, sent
from labweb.common.files.uploads import Bounded, one_file
from labweb.common.requests import Parameter, one_of, seconds, whole_number, word
from labweb.domain.enrollment.driver_spec import UNITS, StatusSpec
from labweb.domain.errors import DefinitionError
from labweb.domain.telemetry_resolution import MOST_POINTS, NAMES
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.telemetry import selectors, services
from labweb.telemetry.answers import (
    PhotoRow,
    TelemetryCurve,
    TelemetryCurves,
    TelemetryGapRow,
    TelemetrySeries,
)
from labweb.telemetry.selectors import DevicePhoto
from labweb.telemetry.services.kept_files import digest_header, opened

_DEFAULT_WINDOW_S = 600.0
_POINTS = 1000
_FEWEST_POINTS = 10
FORMS = ("csv", "parquet")

_RANGE = {
    "since_s": Parameter({"type": "number"}, "Begin, seconds since the Unix epoch."),
    "until_s": Parameter({"type": "number"}, "End; without it, now."),
}
_STATUS = Parameter(
    {"type": "array", "items": {"type": "string"}}, "Which, each once; without it, all."
)


class Telemetry(Endpoint):
    """What a device told."""

    queries = _RANGE

    def get(self, request: Request, device_id: UUID) -> TelemetrySeries:
        """Return the series of each status between `since_s` and `until_s`."""
        device = _device(request, device_id)
        until = seconds(request, "until_s", time.time())
        since = seconds(request, "since_s", until - _DEFAULT_WINDOW_S)
        return TelemetrySeries(series=selectors.series(device.id, since, until))


class Curves(Endpoint):
    """What a device told, as finely as a plot can show it."""

    queries: ClassVar[Mapping[str, Parameter]] = {
        **_RANGE,
        "status": _STATUS,
        "points": Parameter(
            {"type": "integer", "minimum": _FEWEST_POINTS, "maximum": MOST_POINTS},
            "How many a curve may have.",
        ),
    }

    def get(self, request: Request, device_id: UUID) -> TelemetryCurves:
        """Return each status as samples or as buckets, with its level, and the recorded gaps."""
        device = _device(request, device_id)
        since, until = _range(request)
        points = whole_number(
            request, "points", default=_POINTS, low=_FEWEST_POINTS, high=MOST_POINTS
        )
        specs = {status.name: status for status in enrollment_selectors.spec_of(device).statuses}
        asked = _statuses(request, device, specs)
        found = selectors.curves(device.id, since, until, points=points, statuses=asked)
        return TelemetryCurves(
            since_s=since,
            until_s=until,
            curves=[
                TelemetryCurve(
                    status=name,
                    **_words(name, specs.get(name)),
                    level_s=curve.level_s,
                    step_s=curve.step_s,
                    points=curve.points,
                )
                for name, curve in sorted(found.items())
            ],
            gaps=[TelemetryGapRow(**gap) for gap in selectors.gaps(device.id, since, until)],
        )


class Export(Endpoint):
    """What a device told, as a file."""

    answer_type = "text/csv"
    more_types = (services.PARQUET,)

    queries: ClassVar[Mapping[str, Parameter]] = {
        **_RANGE,
        "status": _STATUS,
        "form": one_of(FORMS),
        "level": one_of(NAMES),
    }

    def get(self, request: Request, device_id: UUID) -> StreamingHttpResponse:
        """Return samples, or buckets of a `level`, as CSV or with `form=parquet` as Parquet."""
        device = _device(request, device_id)
        since, until = _range(request)
        form = word(request, "form", FORMS)
        level = word(request, "level", tuple(NAMES))
        specs = {status.name: status for status in enrollment_selectors.spec_of(device).statuses}
        asked = _statuses(request, device, specs)
        wanted = services.WantedSeries(
            device_id=device.id,
            device_key=device.key,
            units={name: _words(name, spec)["unit"] for name, spec in specs.items()},
            statuses=selectors.told_statuses(device.id) if asked is None else asked,
            since_s=since,
            until_s=until,
            level_s=NAMES[level],
        )
        name = f"{device.key}-{level}-{since:.0f}-{until:.0f}.{form}"
        if form == "csv":
            return sent(services.write_csv(wanted), "text/csv; charset=utf-8", name)
        return sent(services.write_parquet(wanted), services.PARQUET, name)


class Photo(Endpoint):
    """What a device looks like."""

    parser_classes = [MultiPartParser]
    answer_type = "image/jpeg"
    forms: ClassVar[dict[str, dict[str, Any]]] = {
        "post": {
            "type": "object",
            "required": ["file"],
            "additionalProperties": False,
            "properties": {"file": {"type": "string", "format": "binary"}},
        }
    }

    statuses: ClassVar = {"post": 201}
    queries: ClassVar[Mapping[str, Parameter]] = {
        "of": Parameter({"type": "string"}, "Names the bytes, so that a browser may keep them.")
    }

    def initialize_request(
        self,
        request: HttpRequest,
        *args: Any,  # noqa: ANN401 - DRF's own shape
        **kwargs: Any,  # noqa: ANN401
    ) -> Request:
        """Bound the upload before the check of the session's token reads the form."""
        request.upload_handlers = [Bounded(request, services.MOST_PHOTO_BYTES)]
        return super().initialize_request(request, *args, **kwargs)

    def get(self, request: Request, device_id: UUID) -> StreamingHttpResponse:
        """Return the newest photo, as JPEG."""
        row = selectors.find_photo(_device(request, device_id)).file
        answer = StreamingHttpResponse(Blocks(opened(row)), content_type=row.media_type)
        answer["Content-Length"] = str(row.size_bytes)
        answer["Repr-Digest"] = digest_header(row)
        answer["ETag"] = f'"{row.sha256}"'
        answer["Cache-Control"] = "private, max-age=86400"
        answer["Content-Security-Policy"] = "sandbox; default-src 'none'"
        return answer

    def post(self, request: Request, device_id: UUID) -> PhotoRow:
        """Keep a photo: a form with one `file`, a JPEG, PNG or WebP of at most 16 MiB."""
        _device(request, device_id)
        _, file = one_file(request, (), services.MOST_PHOTO_BYTES)
        return _photo(services.keep_photo(device_id, file, actor=user_of(request)))


def photo_told(row: DevicePhoto | None) -> PhotoRow | None:
    """Say where a photo is, and who brought it when; None: there is none."""
    return None if row is None else _photo(row)


def _photo(row: DevicePhoto) -> PhotoRow:
    """Say one photo; its address names its bytes."""
    return PhotoRow(
        url=f"/api/v1/devices/{row.device_id}/photo?of={row.file.sha256[:12]}",
        brought_at=row.brought_at,
        brought_by=row.brought_by.printed_name,
    )


def _device(request: Request, device_id: UUID) -> Device:
    return enrollment_selectors.visible_device(device_id, user_of(request))


def _range(request: Request) -> tuple[float, float]:
    until = seconds(request, "until_s", time.time())
    since = seconds(request, "since_s", max(0.0, until - _DEFAULT_WINDOW_S))
    if not since < until:
        raise DefinitionError("since_s must be before until_s", code="http.query")
    return since, until


def _statuses(request: Request, device: Device, specs: dict[str, StatusSpec]) -> list[str] | None:
    """Return the statuses that are asked for, each once; None: all.

    Raises:
        DefinitionError: The device has none of that name, and never told one.
    """
    asked = list(dict.fromkeys(request.query_params.getlist("status")))
    if not asked:
        return None
    unknown = set(asked) - specs.keys()
    if unknown:
        unknown -= set(selectors.told_statuses(device.id))
    if unknown:
        known = ", ".join(sorted(specs)) or "nothing"
        raise DefinitionError(
            f"{device.name} has no status {min(unknown)!r}; it tells {known}",
            code="telemetry.unknown_status",
            context={"unknown": sorted(unknown), "known": sorted(specs)},
        )
    return asked


def _words(name: str, spec: StatusSpec | None) -> dict[str, Any]:
    """Return how a status is called; of one that the driver has no more, only its name."""
    if spec is None:
        return {"label": name, "unit": "", "every_s": None, "is_share": False}
    unit = UNITS[spec.value.unit][1] if spec.value.unit in UNITS else ""
    is_share = spec.value.type == "boolean"
    label = spec.value.label or name
    return {"label": label, "unit": unit, "every_s": spec.every_s, "is_share": is_share}
