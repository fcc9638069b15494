"""Send a file that was made for one answer, block by block."""

from __future__ import annotations

from typing import IO

from asgiref.sync import sync_to_async
from django.http import StreamingHttpResponse
from django.utils.http import content_disposition_header

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


def sent(file: IO[bytes], media_type: str, name: str) -> StreamingHttpResponse:
    """Return the answer that hands a whole file on under a name, and closes it."""
    size = file.seek(0, 2)
    file.seek(0)
    return StreamingHttpResponse(
        Blocks(file),
        content_type=media_type,
        headers={
            "Content-Disposition": content_disposition_header(as_attachment=True, filename=name),
            "Content-Length": str(size),
        },
    )
