"""Requests to an instrument that serves HTTP.

Source:
    HTTP/1.1, RFC 9112; parsed by `http.client` of the standard library.
"""

from __future__ import annotations

import base64
import hashlib
import re
import socket
import ssl
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

from drivers.transports.base import OPEN_TIMEOUT_S, Transport
from drivers.transports.tcp import tcp_line
from labweb.domain.errors import DeviceTimeoutError, Effect, FrameError, UnreachableError

BLOCK_BYTES = 65_536

TOKEN = re.compile(r"[A-Za-z0-9_-]{1,4000}\.[A-Za-z0-9_-]{1,4000}\.[A-Za-z0-9_-]{0,4000}")
"""A signed JSON web token, RFC 7519: what a token file may hold, and nothing else."""

Enough = Callable[[str, bytearray], bool]
"""From the content type and what has come of the body: whether the rest is not wanted."""

Headers = Mapping[str, str]
"""Sent beside those of HTTP itself. No observer sees them: they may hold a secret."""

NO_HEADERS: Headers = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class HttpRequest:
    """A request; what is sent is JSON."""

    method: str
    path: str
    headers: Headers
    body: bytes | None = None


@dataclass(frozen=True, slots=True)
class HttpReply:
    """What came back, within the limits that were asked for."""

    status: int
    headers: dict[str, str]
    """By name in small letters; of a name that comes twice, the last."""

    body: bytes

    @property
    def content_type(self) -> str:
        """Return the media type with its parameters, "" when none is told."""
        return self.headers.get("content-type", "")

    @property
    def told_sha256(self) -> str | None:
        """Return the SHA-256 that the server tells of the whole content, in hex; None: it does not.

        Raises:
            FrameError: What it tells is no digest.

        Source:
            RFC 9530, `Repr-Digest`: a dictionary of byte sequences.
        """
        told = self.headers.get("repr-digest")
        found = None if told is None else re.search(r"(?:^|,)\s*sha-256=:([^:]*):", told)
        if found is None:
            return None
        try:
            digest = base64.b64decode(found[1], validate=True)
        except ValueError as error:
            raise FrameError(f"the digest cannot be read: {told}") from error
        if len(digest) != hashlib.sha256().digest_size:
            raise FrameError(f"the digest has {len(digest)} bytes: {told}")
        return digest.hex()

    @property
    def content_age_s(self) -> float | None:
        """Return how old the content was when it was sent, by the server's own clock.

        None where the server tells one of the two times only, or none.

        Raises:
            FrameError: What it tells are no dates (RFC 9110, 5.6.7).
        """
        told = self.headers.get("last-modified"), self.headers.get("date")
        if told[0] is None or told[1] is None:
            return None
        try:
            made, sent = (parsedate_to_datetime(text) for text in told if text is not None)
            return (sent - made).total_seconds()
        except (TypeError, ValueError) as error:
            raise FrameError(f"the content's time cannot be read: {told}") from error


class HttpTransport(Transport):
    """One address that answers requests; each has a connection of its own.

    No redirect is followed, no proxy is asked and no cookie is kept: what answers is what
    the URL names.
    """

    sort: ClassVar[str] = "http"

    def __init__(
        self,
        url: str,
        host: str,
        port: int,
        *,
        token_file: str | None = None,
        encryption: ssl.SSLContext | None = None,
    ) -> None:
        super().__init__(url, tcp_line(host, port))
        self._address = (host, port)
        self._token_file = token_file
        self._encryption = encryption
        self._is_open = False

    @property
    def is_open(self) -> bool:
        """Tell whether somebody uses the address."""
        return self._is_open

    def token(self) -> str:
        """Read the token that the address names, anew each time: a token is replaced in its file.

        Raises:
            UnreachableError: The address names none, or it cannot be read (NONE).
        """
        try:
            if self._token_file is None:
                raise OSError("the address names none: …?token=/etc/labweb/cluster.token")
            found = Path(self._token_file).read_text("ascii").strip()
            if not TOKEN.fullmatch(found):
                raise OSError(f"{self._token_file} holds no JSON web token")
        except (OSError, UnicodeDecodeError) as error:
            raise UnreachableError(f"no token: {error}", effect=Effect.NONE) from error
        return found

    def _open(self) -> None:
        """Make sure that somebody listens there."""
        try:
            socket.create_connection(self._address, timeout=OPEN_TIMEOUT_S).close()
        except OSError as error:
            raise UnreachableError(
                f"{self.line} cannot be opened: {error}", effect=Effect.NONE
            ) from error
        self._is_open = True

    def _close(self) -> None:
        self._is_open = False

    def get(
        self,
        path: str,
        *,
        timeout_s: float,
        longest_bytes: int,
        enough: Enough = lambda _type, _body: False,
        headers: Headers = NO_HEADERS,
    ) -> HttpReply:
        """Ask for a path and return the reply.

        Args:
            path: From the first slash on.
            timeout_s: Longest time for all of it, however it trickles in.
            longest_bytes: A longer body is refused, told or not.
            enough: Ends the reading of a body that has no end, such as a stream.
            headers: Sent beside those of HTTP itself.

        Raises:
            UnreachableError: No connection (NONE), or it broke (UNKNOWN).
            DeviceTimeoutError: No whole reply in time; UNKNOWN.
            FrameError: No HTTP, a body that is too long, or one that ends early; UNKNOWN.
        """
        return self.request(HttpRequest("GET", path, headers), timeout_s, longest_bytes, enough)

    def put(
        self,
        path: str,
        body: bytes,
        *,
        timeout_s: float,
        longest_bytes: int,
        headers: Headers = NO_HEADERS,
    ) -> HttpReply:
        """Send JSON to a path, once, and return the reply.

        Raises:
            DeviceError: As `get`; whatever the status of the reply, it is returned.
        """
        return self.request(HttpRequest("PUT", path, headers, body), timeout_s, longest_bytes)

    def post(
        self,
        path: str,
        body: bytes,
        *,
        timeout_s: float,
        longest_bytes: int,
        headers: Headers = NO_HEADERS,
    ) -> HttpReply:
        """Send JSON to a path, once, and return the reply; what it begins is never begun again.

        Raises:
            DeviceError: As `get`; whatever the status of the reply, it is returned.
        """
        return self.request(HttpRequest("POST", path, headers, body), timeout_s, longest_bytes)

    def delete(
        self, path: str, *, timeout_s: float, longest_bytes: int, headers: Headers = NO_HEADERS
    ) -> HttpReply:
        """Ask for the end of what a path names, once, and return the reply.

        Raises:
            DeviceError: As `get`; whatever the status of the reply, it is returned.
        """
        return self.request(HttpRequest("DELETE", path, headers), timeout_s, longest_bytes)

    def request(
        self,
        asked: HttpRequest,
        timeout_s: float,
        longest_bytes: int,
        enough: Enough = lambda _type, _body: False,
    ) -> HttpReply:
        """Make one request: `get`, `put`, `post` and `delete` in one.

        Raises:
            DeviceError: As `get`.
        """
        with self.lock:
            self._require_open()
            connection = self._connection(timeout_s)
            self._connect(connection)
            overdue = threading.Event()
            timer = threading.Timer(timeout_s, _hang_up, (connection.sock, overdue))
            timer.daemon = True
            timer.start()
            try:
                self._send(connection, asked)
                return self._answer(connection, longest_bytes, enough)
            except (HTTPException, OSError, ValueError, FrameError) as error:
                raise self._failure(error, is_overdue=overdue.is_set()) from error
            finally:
                timer.cancel()
                connection.close()

    def _connection(self, timeout_s: float) -> HTTPConnection:
        if self._encryption is None:
            return HTTPConnection(*self._address, timeout=timeout_s)
        return HTTPSConnection(*self._address, timeout=timeout_s, context=self._encryption)

    def _connect(self, connection: HTTPConnection) -> None:
        try:
            connection.connect()
        except OSError as error:
            raise UnreachableError(
                f"{self.line} does not answer: {error}",
                effect=Effect.NONE,
                context={"line": self.line},
            ) from error

    def _send(self, connection: HTTPConnection, asked: HttpRequest) -> None:
        body = b"" if asked.body is None else b" " + asked.body
        self._observe("out", f"{asked.method} {asked.path}".encode() + body)
        headers = {**asked.headers, "Connection": "close"}
        if asked.body is not None:
            headers["Content-Type"] = "application/json"
        connection.request(asked.method, asked.path, asked.body, headers)

    def _answer(self, connection: HTTPConnection, longest_bytes: int, enough: Enough) -> HttpReply:
        with connection.getresponse() as response:
            headers = {name.lower(): value for name, value in response.getheaders()}
            body = self._body(response, headers.get("content-type", ""), longest_bytes, enough)
            return HttpReply(response.status, headers, body)

    def _body(
        self, response: HTTPResponse, content_type: str, longest_bytes: int, enough: Enough
    ) -> bytes:
        body = bytearray()
        if (response.length or 0) > longest_bytes:
            raise FrameError(f"a body of {response.length} bytes; {longest_bytes} are allowed")
        while block := response.read1(BLOCK_BYTES):
            self._observe("in", block)
            body += block
            if len(body) > longest_bytes:
                raise FrameError(f"a body of more than {longest_bytes} bytes")
            if enough(content_type, body):
                return bytes(body)
        if response.length:
            raise FrameError(f"the body ended {response.length} bytes early")
        return bytes(body)

    def _failure(
        self, error: Exception, *, is_overdue: bool
    ) -> DeviceTimeoutError | FrameError | UnreachableError:
        context = {"line": self.line}
        if is_overdue or isinstance(error, TimeoutError):
            return DeviceTimeoutError("no whole answer in time", context=context)
        if isinstance(error, FrameError):
            error.context |= context
            return error
        if isinstance(error, OSError):
            return UnreachableError(
                f"the line broke: {error}", effect=Effect.UNKNOWN, context=context
            )
        return FrameError(f"the answer is no HTTP: {error!r}", context=context)


def _hang_up(opened: socket.socket, overdue: threading.Event) -> None:
    """End a connection whose time is over, whatever it waits for."""
    overdue.set()
    try:
        opened.shutdown(socket.SHUT_RDWR)
    except OSError:
        return  # it ended by itself just now
