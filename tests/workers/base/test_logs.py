"""A log on a full disk ends nothing, and tells later how much of it is missing."""

import io
import logging
import os
from collections.abc import Callable

import pytest

from labweb.common.logs import LossyStream as OfServer
from workers.base.logs import LossyLogStream as OfHost


class _Full(io.StringIO):
    """A file on a full disk, as the kernel has it."""

    def write(self, text: str) -> int:
        handle = os.open("/dev/full", os.O_WRONLY)
        try:
            return os.write(handle, text.encode())
        finally:
            os.close(handle)


@pytest.mark.parametrize("kind", [OfHost, OfServer])
def test_lost_lines_are_counted_and_told_with_the_next_one(
    kind: Callable[[], OfHost | OfServer], capsys: pytest.CaptureFixture[str]
) -> None:
    handler = kind()
    logger = logging.getLogger(f"{kind.__module__}.test")
    logger.propagate = False
    logger.addHandler(handler)
    full, taken = _Full(), io.StringIO()
    for stream, texts in ((full, ("one", "two")), (taken, ("three", "four"))):
        handler.setStream(stream)
        for text in texts:
            logger.warning(text)
    assert capsys.readouterr().err == "", "logging has written its own trouble past the log"
    first, *rest = taken.getvalue().splitlines()
    assert first.startswith("2 lines of this log were lost: ")
    assert "No space left on device" in first
    assert rest == ["three", "four"]
