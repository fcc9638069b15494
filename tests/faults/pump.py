"""A counting syringe pump in threads of the test, beside the process under test.

It speaks as `tests/workers/pump_server.py` does, keeps its count in this process, and has a
second port at which a fault tells it to fall silent or to stop within its stroke.
"""

from __future__ import annotations

import contextlib
import re
import socket
import threading
import time
from types import TracebackType

STALLS_AT = 0.4
"""Where within its stroke a stalled plunger stands."""

STEPS_PER_UL = 3


class CountingPump:
    """One pump, one port to speak to it and one to break it."""

    def __init__(self, *, slowness: float = 1.5) -> None:
        self.moves: list[int] = []
        self.speeds: list[int] = []
        """Of each move; a test may tell its actions apart by them."""

        self.is_mute = False
        self.is_stalled = False
        self._slowness = slowness
        self._from, self._target, self._began_s, self._speed = 0.0, 0.0, 0.0, 1.0
        self._port = 1
        self._lock = threading.Lock()
        self._line, self._control = _listen(), _listen()
        self._threads = [
            threading.Thread(target=self._serve, args=(server, talk), daemon=True)
            for server, talk in ((self._line, self._talk), (self._control, self._obey))
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> CountingPump:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        # A thread that still waited would serve whoever gets the number of its file next: a call
        # that a stopped process was in is begun anew, by that number.
        for server in (self._line, self._control):
            server.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        self._line.close()
        self._control.close()

    @property
    def url(self) -> str:
        return f"tcp://127.0.0.1:{self._line.getsockname()[1]}"

    @property
    def control(self) -> str:
        return f"127.0.0.1:{self._control.getsockname()[1]}"

    @property
    def moved_ul(self) -> float:
        """What was really drawn in."""
        with self._lock:
            return self._position() / STEPS_PER_UL

    @property
    def is_standing(self) -> bool:
        with self._lock:
            return self._is_idle()

    def cure(self) -> None:
        with self._lock:
            self.is_mute = False

    def _position(self) -> float:
        """Return where the plunger stands: at a whole step, wherever it is halted."""
        way = self._target - self._from
        limit = abs(way) * (STALLS_AT if self.is_stalled else 1.0)
        gone = min((time.monotonic() - self._began_s) * self._speed / self._slowness, limit)
        return self._from + int(gone if way > 0 else -gone)

    def _stall(self) -> None:
        """Stop within the stroke that is under way, and within each later one."""
        if self._is_idle():
            self._from = self._target
        self.is_stalled = True

    def _is_idle(self) -> bool:
        way = abs(self._target - self._from)
        limit = way * (STALLS_AT if self.is_stalled else 1.0)
        return (time.monotonic() - self._began_s) * self._speed / self._slowness >= limit

    def _answer(self, request: str) -> bytes:
        with self._lock:
            data = self._take(request)
            status = bytes([0x40 | (0x20 if self._is_idle() else 0)])
            return b"/0" + status + data.encode() + b"\x03\r\n"

    def _take(self, request: str) -> str:
        simple = {"?19": "1", "?23": "TEST 1.0", "?6": str(self._port), "Q": ""}
        if request in simple:
            return simple[request]
        if request == "?":
            return str(round(self._position()))
        if request == "TR":
            self._from = self._target = self._position()
            return ""
        found = re.fullmatch(r"V(\d+)A(\d+)R", request)
        assert found is not None, request
        self._from, self._target = self._position(), float(found[2])
        self._speed, self._began_s = float(found[1]), time.monotonic()
        self.moves.append(int(found[2]))
        self.speeds.append(int(found[1]))
        return ""

    def _serve(self, server: socket.socket, talk: object) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = server.accept()
                threading.Thread(target=talk, args=(client,), daemon=True).start()  # type: ignore[arg-type]

    def _talk(self, client: socket.socket) -> None:
        waiting = b""
        with contextlib.suppress(OSError), client:
            while data := client.recv(4096):
                waiting += data
                while b"\r" in waiting:
                    line, _, waiting = waiting.partition(b"\r")
                    # A silent pump still acts: the worst kind.
                    answer = self._answer(line.decode().removeprefix("/1"))
                    if not self.is_mute:
                        client.sendall(answer)

    def _obey(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError), client:
            word = client.recv(64).decode().strip()
            with self._lock:
                self.is_mute = self.is_mute or word == "mute"
                if word == "stall":
                    self._stall()
            client.sendall(b"ok\n")


def _listen() -> socket.socket:
    return socket.create_server(("127.0.0.1", 0))
