"""A furnace's program on the S7 server of python-snap7: a public server, and the table's block."""

import struct
import threading
from typing import Any

from snap7.server import Server
from snap7.type import SrvArea

ON, DOOR, ERROR, REMOTE = 0x01, 0x04, 0x08, 0x10


class Plc:
    """The controller's program: it looks at its block every few milliseconds, as such do."""

    def __init__(self, port: int) -> None:
        self.block = bytearray(48)
        self.put(34, ">ff", 20.0, 1100.0)
        self.put(22, ">f", 20.0)
        self.put(46, ">H", 1)
        self.block[18] = REMOTE
        self.refuses = 0
        self.is_deaf = False
        self.starts: list[tuple[float, float]] = []
        self.step_c = 200.0
        self._server = Server(log=False)
        self._server.register_area(SrvArea.DB, 10, self.block)
        self._server.start(port)
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def put(self, at: int, form: str, *values: float) -> None:
        struct.pack_into(form, self.block, at, *values)

    def get(self, at: int, form: str) -> Any:  # noqa: ANN401 - as struct
        return struct.unpack_from(form, self.block, at)[0]

    def fail(self, error: int) -> None:
        self.put(20, ">h", error)
        self.block[18] = (self.block[18] | ERROR) & ~ON

    @property
    def is_on(self) -> bool:
        return bool(self.block[18] & ON)

    def close(self) -> None:
        self._is_over.set()
        self._thread.join()
        self._server.stop()

    def _run(self) -> None:
        while not self._is_over.wait(0.005):
            commands = 0 if self.is_deaf else self.block[12]
            if commands:
                self.block[12] = 0
            if commands & 4:
                self.put(20, ">h", 0)
                self.block[18] &= ~ERROR
            if commands & 2:
                self.block[18] &= ~ON
            if commands & 1:
                self._start()
            self._heat()

    def _start(self) -> None:
        if self.refuses:
            self.fail(self.refuses)
            return
        self.put(16, ">H", self.get(14, ">H"))
        self.block[18] |= ON
        self.starts.append((self.get(0, ">f"), self.get(4, ">f")))

    def _heat(self) -> None:
        goal = self.get(0, ">f") if self.is_on else 20.0
        now = self.get(22, ">f")
        self.put(22, ">f", now + max(-self.step_c, min(self.step_c, goal - now)))
