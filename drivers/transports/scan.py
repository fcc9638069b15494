"""Look what is on this machine's wires, without a byte to anything.

Serial ports are listed and not opened; at an address a connection is tried and closed.
"""

from __future__ import annotations

import socket
import stat
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports

CONNECT_S = 0.5


@dataclass(frozen=True, slots=True)
class SerialPort:
    """One serial port of this machine."""

    path: str
    name: str = ""
    model: str = ""
    serial: str = ""


def serial_ports(patterns: Iterable[str]) -> list[SerialPort]:
    """List the serial ports whose path fits a pattern; none is opened.

    What hangs on USB says its name and serial number by itself.
    """
    known = {
        port.device: SerialPort(
            port.device,
            port.product or port.description or "",
            "" if port.vid is None else f"{port.vid:04x}:{port.pid:04x}",
            port.serial_number or "",
        )
        for port in list_ports.comports()
    }
    paths = sorted({str(path) for pattern in patterns for path in _matching(pattern)})
    return [known.get(path, SerialPort(path)) for path in paths if _is_port(path)]


def _matching(pattern: str) -> Iterable[Path]:
    whole = Path(pattern)
    return Path(whole.anchor).glob(str(whole.relative_to(whole.anchor))) if whole.name else ()


def _is_port(path: str) -> bool:
    try:
        return stat.S_ISCHR(Path(path).stat().st_mode)
    except OSError:
        return False


def is_listening(host: str, port: int) -> bool:
    """Say whether something takes a TCP connection there; it is closed at once."""
    try:
        with socket.create_connection((host, port), timeout=CONNECT_S):
            return True
    except OSError:
        return False
