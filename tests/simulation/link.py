"""A connection of a host of the simulation to its server."""

from __future__ import annotations

from collections import deque
from typing import Any


class Link:
    """One connection of a host to the server; what is on the wire may be lost with it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.up: deque[Any] = deque()
        self.down: deque[Any] = deque()
        self.is_cut = False
        self.cut_at_s = 0.0
        self.server_epoch: int | None = None
        """Session of the server's end; None until HELLO."""

        self.is_resumed = False
        self.pending_head = 0
        self.is_closed_at_server = False
