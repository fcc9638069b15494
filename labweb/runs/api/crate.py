"""The download of a run as an RO-Crate."""

from __future__ import annotations

from typing import IO
from uuid import UUID

from asgiref.sync import sync_to_async
from django.http import StreamingHttpResponse
from django.utils.http import content_disposition_header
from rest_framework.request import Request
from rest_framework.views import APIView

from labweb.accounts.selectors import user_of
from labweb.domain.approvals.roles import Permission
from labweb.resources import selectors as resource_selectors
from labweb.runs.api.runs import visible
from labweb.runs.services.crate import pack_run
from labweb.runs.services.eln import MEDIA_TYPE, name_of, pack_eln

_BLOCK = 2**18


class Blocks:
    """A file block by block, as ASGI sends it; Django closes it with the answer.

    A plain iterator would be read whole into memory before the first byte is sent.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def __aiter__(self) -> Blocks:
        return self

    async def __anext__(self) -> bytes:
        block = await sync_to_async(self._file.read)(_BLOCK)
        if not block:
            raise StopAsyncIteration
        return block

    def close(self) -> None:
        """Close the file, and so remove it."""
        self._file.close()


class RunCrate(APIView):
    """A run with all that belongs to it, in one file."""

    answer_type = "application/zip"

    def get(self, request: Request, run_id: UUID) -> StreamingHttpResponse:
        """Return a ZIP file: workflow version, plan, events, telemetry, readings, provenance."""
        user = user_of(request)
        run = visible(run_id, user)
        packed = pack_run(run, resource_selectors.allowed_ids(user, Permission.VIEW))
        return _sent(packed, self.answer_type, f"run-{run.number}.crate.zip")


class RunEln(APIView):
    """A run for an electronic lab notebook."""

    answer_type = MEDIA_TYPE

    def get(self, request: Request, run_id: UUID) -> StreamingHttpResponse:
        """Return an .eln file: the crate of the run as one experiment."""
        user = user_of(request)
        run = visible(run_id, user)
        packed = pack_eln(run, resource_selectors.allowed_ids(user, Permission.VIEW))
        return _sent(packed, self.answer_type, f"{name_of(run)}.eln")


def _sent(packed: IO[bytes], media_type: str, name: str) -> StreamingHttpResponse:
    size = packed.seek(0, 2)
    packed.seek(0)
    return StreamingHttpResponse(
        Blocks(packed),
        content_type=media_type,
        headers={
            "Content-Disposition": content_disposition_header(as_attachment=True, filename=name),
            "Content-Length": str(size),
        },
    )
