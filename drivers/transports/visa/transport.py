"""A line to a VISA instrument, as bytes: USB, GPIB, or HiSLIP over TCP.

An instrument on such a line must not be read from before it was asked: it would report an error of
its own. What it may still owe after a failed exchange is therefore thrown away by a device clear.
The library is imported when a line is opened: other hosts lack it.

Source:
    IVI Foundation, VPP-4.3 (resource names, viClear) and IVI-6.1 (HiSLIP, port 4880); IEEE 488.2,
    6.3.1.7, query errors; USB-IF, USBTMC-USB488 1.0 (vendor, product, serial number).
"""

from __future__ import annotations

import re
from importlib import import_module
from typing import TYPE_CHECKING

from drivers.transports.base import OPEN_TIMEOUT_S, QUIET_S, ByteTransport, Transport
from drivers.transports.tcp import tcp_line
from labweb.domain.errors import DefinitionError, Effect, UnreachableError

if TYPE_CHECKING:
    from drivers.transports.visa.link import VisaLink

LIBRARY = "@py"
HISLIP_PORT = 4880
_GPIB = re.compile(r"GPIB([0-9]{1,2})::([0-9]{1,2})(?:::([0-9]{1,2}))?::INSTR")
_HISLIP = re.compile(r"TCPIP[0-9]{1,2}::([A-Za-z0-9._-]{1,253})::hislip[0-9]::INSTR")
_USB = re.compile(
    r"USB[0-9]{0,2}::0x([0-9A-Fa-f]{4})::0x([0-9A-Fa-f]{4})::([A-Za-z0-9._-]{1,126})::INSTR"
)
_HIGHEST_ADDRESS = 30  # IEEE 488.1: 31 is none


def check_resource(name: str) -> str:
    """Return the line of a resource.

    Raises:
        DefinitionError: It is none of those that are driven.

    Example:
        >>> check_resource("GPIB0::8::INSTR")
        'gpib:0'
        >>> check_resource("USB0::0x2A8D::0x1301::MY1::INSTR")
        'usb:2a8d:1301:MY1'
    """
    if found := _GPIB.fullmatch(name):
        if any(int(part) > _HIGHEST_ADDRESS for part in (found[2], found[3] or "0")):
            raise DefinitionError(
                f"an address on a GPIB bus goes to {_HIGHEST_ADDRESS}", code="transport.url"
            )
        return f"gpib:{int(found[1])}"
    if found := _HISLIP.fullmatch(name):
        return tcp_line(found[1], HISLIP_PORT)
    if found := _USB.fullmatch(name):
        return f"usb:{found[1].lower()}:{found[2].lower()}:{found[3]}"
    raise DefinitionError(
        "a VISA instrument is USB0::0x2A8D::0x1301::MY1::INSTR, GPIB0::8::INSTR or "
        "TCPIP0::HOST::hislip0::INSTR; serial ports and sockets are serial:// and tcp://",
        code="transport.url",
    )


class VisaTransport(ByteTransport):
    """One instrument; those on one GPIB bus take turns."""

    def __init__(self, url: str, resource: str, library: str = LIBRARY) -> None:
        super().__init__(url, check_resource(resource))
        self._resource, self._library = resource, library
        self._link: VisaLink | None = None

    @property
    def is_open(self) -> bool:
        """Tell whether there is a session."""
        return self._link is not None

    def for_url(self, url: str) -> Transport:
        """Return this instrument for its own URL, and a companion for another on the same bus."""
        resource = url.removeprefix("visa://")
        if url in {self.url, resource} or check_resource(resource) != self.line:
            return super().for_url(url)
        return _Companion(self, url, resource, self._library)

    def _open(self) -> None:
        try:
            module = import_module("drivers.transports.visa.link")
        except ImportError as error:
            text = f"{error}: this host lacks the extra edge-visa"
            raise UnreachableError(text, effect=Effect.NONE) from error
        try:
            self._link = module.VisaLink(self._resource, self._library, OPEN_TIMEOUT_S)
        except OSError as error:
            raise UnreachableError(
                f"{self.line} cannot be opened: {error}", effect=Effect.NONE
            ) from error

    def _close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _put(self, data: bytes) -> None:
        self._opened().send(data)

    def _take(self, timeout_s: float) -> bytes:
        return self._opened().receive(timeout_s)

    def _drain(self) -> None:
        """After a failed exchange, make the instrument forget what it still has to say."""
        if not self._may_owe_bytes:
            return
        if not self._opened().clear():
            while part := self._take(QUIET_S):
                self._observe("in", part)
        self._may_owe_bytes = False

    def _opened(self) -> VisaLink:
        if self._link is None:
            raise OSError("the session is closed")
        return self._link


class _Companion(VisaTransport):
    """Another instrument on a bus that is already there: a session of its own, the same turns."""

    def __init__(self, owner: VisaTransport, url: str, resource: str, library: str) -> None:
        super().__init__(url, resource, library)
        self.lock = owner.lock
        self._owner = owner

    def open(self) -> None:
        with self.lock:
            if not self.is_open:
                self._open()

    def close(self) -> None:
        with self.lock:
            self._users.clear()
            self._close()

    def for_url(self, url: str) -> Transport:
        return self if url == self.url else self._owner.for_url(url)
