"""One connection to an S7 controller, by the frames of python-snap7.

It never connects again by itself, and sends no request a second time.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

from snap7.connection import ISOTCPConnection
from snap7.datatypes import S7Area, S7WordLen
from snap7.error import S7ConnectionError, S7Error, S7ProtocolError, S7TimeoutError
from snap7.s7protocol import S7Protocol

from drivers.transports.s7.codes import TAKEN, failure_of_item, failure_of_job
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    UnreachableError,
)

LOCAL_TSAP = 0x0100
PROGRAMMER = 0x0100
"""Sort of connection in the high byte of the called TSAP; rack and slot are in the low one."""

RACK_BITS = 5
LONGEST_PDU = 480
Observer = Callable[[bool, bytes], None]
logging.getLogger("snap7").setLevel(logging.CRITICAL)


class S7Link:
    """A connection; one request at a time, from one thread at a time."""

    def __init__(
        self, host: str, port: int, rack: int, slot: int, timeout_s: float, observer: Observer
    ) -> None:
        """Begin nothing.

        Args:
            host: Address of the controller.
            port: 102 in life.
            rack: Of the controller.
            slot: Of its processor.
            timeout_s: Longest wait for each answer.
            observer: Is shown every S7 frame, with True where it goes out.
        """
        self._line = f"tcp:{host}:{port}"
        self._timeout_s = timeout_s
        self._observer = observer
        self._frames = S7Protocol()
        called = PROGRAMMER | rack << RACK_BITS | slot
        self._connection = ISOTCPConnection(host, port, LOCAL_TSAP, called)

    @property
    def is_connected(self) -> bool:
        """Tell whether the connection still stands, as far as is known."""
        return bool(self._connection.connected)

    def open(self) -> None:
        """Connect, and agree upon the length of frames.

        Raises:
            UnreachableError: It did not work; NONE.
        """
        try:
            self._connection.connect(self._timeout_s)
            self._ask(self._frames.build_setup_communication_request(pdu_length=LONGEST_PDU))
        except (S7Error, OSError, DeviceError) as error:
            self.close()
            raise UnreachableError(
                f"{self._line} cannot be opened: {error}", effect=Effect.NONE
            ) from error

    def close(self) -> None:
        """End the connection. May be called twice."""
        self._connection.disconnect()

    def read(self, block: int, start: int, count: int) -> bytes:
        """Return bytes of a data block.

        Raises:
            DeviceError: As `S7Transport.read`.
        """
        what = f"DB{block} bytes {start} to {start + count - 1}"
        request = self._frames.build_read_request(S7Area.DB, block, start, S7WordLen.BYTE, count)
        answer = self._ask(request)
        self._refuse_item(answer, what)
        try:
            return bytes(self._frames.extract_read_data(answer, S7WordLen.BYTE, count))
        except S7ProtocolError as error:
            raise self._noise(error) from error

    def write(self, block: int, start: int, data: bytes) -> None:
        """Write bytes of a data block in one frame.

        Raises:
            DeviceError: As `S7Transport.write`.
        """
        what = f"DB{block} bytes {start} to {start + len(data) - 1}"
        request = self._frames.build_write_request(S7Area.DB, block, start, S7WordLen.BYTE, data)
        answer = self._ask(request)
        self._refuse_item(answer, what)
        try:
            self._frames.check_write_response(answer)
        except S7ProtocolError as error:
            raise self._noise(error) from error

    def _ask(self, request: bytes) -> dict[str, Any]:
        """Send a frame and return the answer that has its number; older ones are passed over."""
        try:
            self._observer(True, request)  # noqa: FBT003 - it goes out
            self._connection.send_data(request)
            deadline_s = time.monotonic() + self._timeout_s
            while time.monotonic() < deadline_s:
                frame = self._connection.receive_data()
                self._observer(False, frame)  # noqa: FBT003 - it came in
                answer = self._frames.parse_response(frame)
                if answer["sequence"] == self._frames.sequence:
                    return answer
        except S7TimeoutError as error:
            raise self._late() from error
        except S7ProtocolError as error:
            if error.error_code:
                raise failure_of_job(error.error_code, self._line) from error
            raise self._noise(error) from error
        except (S7ConnectionError, OSError) as error:
            if self._connection.connected:  # the library does not like the frame, the line stands
                raise self._noise(error) from error
            raise UnreachableError(
                f"the line broke: {error}", effect=Effect.UNKNOWN, context={"line": self._line}
            ) from error
        raise self._late()

    def _refuse_item(self, answer: dict[str, Any], what: str) -> None:
        code = (answer.get("data") or {}).get("return_code")
        if code is not None and code != TAKEN:
            raise failure_of_item(int(code), what, self._line)

    def _late(self) -> DeviceTimeoutError:
        return DeviceTimeoutError("no whole answer in time", context={"line": self._line})

    def _noise(self, error: Exception) -> FrameError:
        return FrameError(f"the answer cannot be read: {error}", context={"line": self._line})
