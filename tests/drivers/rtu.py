"""A serial line on which a transcript of Modbus RTU answers."""

from __future__ import annotations

import os
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.transports.replay import parse_transcript

TRANSCRIPTS = Path(__file__).parent / "transcripts"
REQUEST_LENGTH = 8
"""Of function 3: device, function, first register, count, check."""


@contextmanager
def line_of(name: str) -> Iterator[str]:
    """Yield the path of a serial port; each exchange must come in its turn, and all of them."""
    script = list(parse_transcript((TRANSCRIPTS / f"{name}.txt").read_text(encoding="utf-8")))
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    wrong: list[str] = []
    is_over = threading.Event()

    def answer() -> None:
        heard = b""
        while not is_over.is_set():
            if not select.select([ours], [], [], 0.05)[0]:
                continue
            heard += os.read(ours, 256)
            while len(heard) >= REQUEST_LENGTH:
                request, heard = heard[:REQUEST_LENGTH], heard[REQUEST_LENGTH:]
                if not script or script[0].request != request:
                    wrong.append(request.hex())
                    return
                os.write(ours, script.pop(0).reply)

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        is_over.set()
        thread.join(5)
        os.close(ours)
        os.close(theirs)
    assert wrong == []
    assert script == []
