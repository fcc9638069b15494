"""What the driver tests share: transcripts, and drivers that speak to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.transports.replay import ReplayTransport, parse_transcript

TRANSCRIPTS = Path(__file__).parent / "transcripts"

Play = Callable[..., ReplayTransport]


@pytest.fixture
def play() -> Iterator[Play]:
    """Open transcripts by name, or from text; each must be asked to its end."""
    opened: list[ReplayTransport] = []

    def start(name: str = "", *, text: str = "") -> ReplayTransport:
        path = TRANSCRIPTS / f"{name}.txt"
        exchanges = parse_transcript(path.read_text(encoding="utf-8") if name else text)
        transport = ReplayTransport(exchanges, line=f"replay:{name}{len(opened)}")
        transport.open()
        opened.append(transport)
        return transport

    yield start
    for transport in opened:
        transport.close()
        assert transport.remaining == []
