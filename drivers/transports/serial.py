"""A serial port, by pyserial; a pseudo-terminal works as well."""

from __future__ import annotations

import os
import select
import termios
from dataclasses import dataclass

import serial

from drivers.transports.base import OPEN_TIMEOUT_S, ByteTransport
from labweb.domain.errors import Effect, UnreachableError


@dataclass(frozen=True, slots=True)
class SerialSettings:
    """How a port is set."""

    path: str
    baud: int = 9600
    data_bits: int = 8
    parity: str = "N"
    stop_bits: int = 1
    flow: str = "none"
    """Handshake: `none`, `rtscts` by lines of the cable, `xonxoff` by signs among the bytes."""


class SerialTransport(ByteTransport):
    """One serial port, held alone."""

    def __init__(self, url: str, settings: SerialSettings) -> None:
        super().__init__(url, serial_line(settings.path))
        self.settings = settings
        self._port: serial.Serial | None = None

    @property
    def is_open(self) -> bool:
        """Tell whether the port is open."""
        return self._port is not None

    def _open(self) -> None:
        settings = self.settings
        has_framing = not is_pseudo_terminal(settings.path)
        try:
            self._port = serial.Serial(
                port=settings.path,
                baudrate=settings.baud,
                bytesize=settings.data_bits if has_framing else 8,
                parity=settings.parity if has_framing else "N",
                stopbits=settings.stop_bits,
                rtscts=settings.flow == "rtscts",
                xonxoff=settings.flow == "xonxoff",
                timeout=0,
                write_timeout=OPEN_TIMEOUT_S,
                exclusive=True,
            )
        except (OSError, ValueError, termios.error) as error:
            raise UnreachableError(
                f"{self.line} cannot be opened: {error}", effect=Effect.NONE
            ) from error

    def _close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def _put(self, data: bytes) -> None:
        port = self._opened()
        port.write(data)
        port.flush()

    def _take(self, timeout_s: float) -> bytes:
        # Waiting by select and not by the port's own timeout: to change that, pyserial sets
        # the whole line anew.
        port = self._opened()
        if not select.select([port.fileno()], [], [], timeout_s)[0]:
            return b""
        part: bytes = port.read(max(1, port.in_waiting))
        return part

    def _opened(self) -> serial.Serial:
        if self._port is None:
            raise OSError("port is closed")
        return self._port


def is_pseudo_terminal(path: str) -> bool:
    """Tell whether a path leads to a pseudo-terminal, which carries bytes without framing.

    Linux keeps eight bits and no parity there whatever is asked, and refuses the second
    time that it is asked.
    """
    return os.path.realpath(path).startswith("/dev/pts/")


def serial_line(path: str) -> str:
    """Name the wire by the path that was configured.

    Links are not followed: where one points may change while the name of a line must not,
    and the exclusive open keeps two names of one port from being driven at once.
    """
    return f"serial:{os.path.normpath(path)}"
