"""A transcript insists on its order, and says what it did not expect."""

from __future__ import annotations

import pytest

from drivers.transports.replay import (
    ReplayTransport,
    TranscriptMismatchError,
    parse_transcript,
)
from labweb.domain.errors import DeviceTimeoutError


def test_requests_must_come_in_order() -> None:
    line = ReplayTransport(parse_transcript("> a\\n\n< 1\\n\n> b\\n\n< 2\\n\n"))
    line.open()
    with pytest.raises(TranscriptMismatchError):
        line.exchange(b"b\n", until=b"\n", timeout_s=1)
    assert line.exchange(b"a\n", until=b"\n", timeout_s=1) == b"1\n"
    assert line.remaining == [b"b\n"]
    assert line.exchange(b"b\n", until=b"\n", timeout_s=1) == b"2\n"
    with pytest.raises(TranscriptMismatchError, match="end"):
        line.exchange(b"b\n", until=b"\n", timeout_s=1)
    line.close()


def test_a_request_without_an_answer_meets_silence_at_once() -> None:
    line = ReplayTransport(parse_transcript("> a\\n"))
    line.open()
    with pytest.raises(DeviceTimeoutError):
        line.exchange(b"a\n", until=b"\n", timeout_s=3600)
    line.close()


@pytest.mark.parametrize("text", ["< a", "a", "> \\xZZ", '> a" + b"b'])
def test_a_line_that_is_not_bytes_is_refused_with_its_number(text: str) -> None:
    if text.startswith("> a"):
        assert parse_transcript(text)[0].request == b'a" + b"b'
        return
    with pytest.raises(ValueError, match="line 1"):
        parse_transcript(text)
