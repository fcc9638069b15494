"""Take uploaded files to disk as they come, and break off beyond a bound."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NoReturn, cast

from django.core.files.uploadedfile import UploadedFile
from django.core.files.uploadhandler import StopUpload, TemporaryFileUploadHandler
from django.http import HttpRequest, QueryDict
from django.http.multipartparser import MultiPartParserError
from rest_framework.request import Request

from labweb.domain.errors import DefinitionError

MOST_OTHER_BYTES = 16 * 2**20
"""Most of a form that says no bound of its own."""

ENVELOPE_BYTES = 64 * 1024
"""What the other fields and the boundaries of a form may take."""


class Bounded(TemporaryFileUploadHandler):
    """Writes the files of one form to disk as they come, and breaks off beyond the bound."""

    def __init__(
        self,
        request: Any = None,  # noqa: ANN401 - Django's own request
        most_bytes: int = MOST_OTHER_BYTES,
    ) -> None:
        super().__init__(request)
        self.most_bytes = most_bytes
        self.size = 0

    def receive_data_chunk(self, raw_data: bytes, start: int) -> bytes | None:
        """Count and write."""
        self.size += len(raw_data)
        if self.size > self.most_bytes:
            raise StopUpload(connection_reset=True)
        super().receive_data_chunk(raw_data, start)
        return None


def check_whole(request: HttpRequest, most_bytes: int) -> None:
    """See to it that a form that was read is all that was sent.

    Raises:
        DefinitionError: `file.too_large`: reading it was broken off.
    """
    if any(isinstance(one, Bounded) and one.size > most_bytes for one in request.upload_handlers):
        _too_large(most_bytes)


def one_file(
    request: Request, fields: Collection[str], most_bytes: int
) -> tuple[QueryDict, UploadedFile[Any]]:
    """Read a form with one file, which is written to disk as it comes.

    Raises:
        DefinitionError: `file.too_large`; or `http.body`: it is no form of these fields.
    """
    length = request.META.get("CONTENT_LENGTH") or ""
    if length.isascii() and length.isdigit() and int(length) > most_bytes + ENVELOPE_BYTES:
        _too_large(most_bytes)
    try:
        form, files = request.data, request.FILES
    except MultiPartParserError as error:
        raise DefinitionError(f"the form cannot be read: {error}", code="http.body") from error
    check_whole(request._request, most_bytes)  # noqa: SLF001 - where Django keeps its handlers
    strange = set(form) - {*fields, "file"}
    if strange or list(files) != ["file"] or len(files.getlist("file")) != 1:
        also = f", and {', '.join(sorted(fields))}" if fields else ", and nothing else"
        raise DefinitionError(
            f"the form has one file called file{also}",
            code="http.body",
            context={"strange": sorted(map(str, strange))},
        )
    return cast(QueryDict, form), cast("UploadedFile[Any]", files["file"])


def _too_large(most_bytes: int) -> NoReturn:
    raise DefinitionError(
        f"a file may have {most_bytes} bytes here",
        code="file.too_large",
        context={"most_bytes": most_bytes},
    )
