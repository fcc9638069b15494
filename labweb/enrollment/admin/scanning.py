"""What a device shows, read by a camera or from a photo, into the field where it would be typed."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import msgspec
from django.core.files.uploadedfile import TemporaryUploadedFile
from django.http import HttpRequest, HttpResponse, JsonResponse
from django.http.response import HttpResponseBase
from django.views.decorators.http import require_POST

from labweb.common.files.picture_process import read_apart
from labweb.common.files.uploads import check_whole
from labweb.domain.errors import DefinitionError

MOST_BYTES = 16 * 2**20
UNPROCESSABLE = 422
Answer = TypeVar("Answer", bound=HttpResponseBase)


def with_camera(answer: Answer) -> Answer:
    """Let a page ask the browser for its camera; every other page may not."""
    answer["Permissions-Policy"] = "camera=(self), microphone=(), geolocation=()"
    return answer


@require_POST
def scan(request: HttpRequest) -> HttpResponse:
    """Answer the text of the one code in a picture; nothing of it is kept."""
    try:
        return JsonResponse({"text": _text_in(request)})
    except DefinitionError as refusal:
        told = {"code": refusal.code, "message": refusal.message}
        return JsonResponse(told, status=UNPROCESSABLE)


def _text_in(request: HttpRequest) -> str:
    """Return what is read in the picture of a form.

    Raises:
        DefinitionError: `file.empty`, `file.too_large`, `photo.unreadable`,
            `photo.too_many_pixels`; `photo.no_code`, `photo.several_codes`.
    """
    picture = request.FILES.get("picture")
    check_whole(request, MOST_BYTES)
    if not isinstance(picture, TemporaryUploadedFile) or not picture.size:
        raise DefinitionError("choose a photo first", code="file.empty")
    path = Path(picture.temporary_file_path())
    texts = msgspec.json.decode(read_apart("labweb.common.files.codes", path), type=list[str])
    if not texts:
        text = "no code was read in the picture: come nearer, hold still, or type it"
        raise DefinitionError(text, code="photo.no_code")
    if len(texts) > 1:
        text = f"the picture shows {len(texts)} codes: take one of the device's own alone"
        raise DefinitionError(text, code="photo.several_codes")
    return texts[0]
