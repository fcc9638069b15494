"""A call as a request, and its answer as a struct; whoever sends them does nothing else."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, TypeVar, cast
from urllib.parse import urlsplit

import msgspec

from labweb_client.errors import CallRefusedError, CallUnansweredError, LabwebError, ServerRefusal

A = TypeVar("A")

API = "/api/v1"
KEY_HEADER = "Idempotency-Key"
Files = Mapping[str, tuple[str, bytes, str]]
"""Field of a form → name, content and media type of the file."""

_ACTING = frozenset({"POST", "PUT", "PATCH", "DELETE"})
_AGAIN = frozenset(
    {
        HTTPStatus.TOO_MANY_REQUESTS,
        HTTPStatus.INTERNAL_SERVER_ERROR,
        HTTPStatus.BAD_GATEWAY,
        HTTPStatus.SERVICE_UNAVAILABLE,
        HTTPStatus.GATEWAY_TIMEOUT,
    }
)
_OWN_MACHINE = frozenset({"localhost", "127.0.0.1", "::1"})
_IN_PROGRESS = "http.in_progress"
_LONGEST_WAIT_S = 30.0
_FIRST_WAIT_S = 0.25


def address_of(url: str, *, is_plain_allowed: bool = False) -> str:
    """Return the address of a server without a slash at its end.

    Raises:
        ValueError: It is none, or an access token would cross the network unencrypted.
    """
    parts = urlsplit(url)
    if parts.scheme not in {"http", "https"} or not parts.hostname:
        raise ValueError(f"{url!r} is no address of a server, such as https://lab.example.org")
    if parts.scheme == "http" and not is_plain_allowed and parts.hostname not in _OWN_MACHINE:
        text = "sends the access token unencrypted: write https://, or allow it (is_plain_allowed)"
        raise ValueError(f"{url} {text}")
    return url.rstrip("/")


@dataclass(frozen=True, slots=True, kw_only=True)
class ApiCall:
    """One wish: it has one effect, however often it is sent."""

    method: str
    path: str
    query: Mapping[str, Any] = field(default_factory=dict)
    body: msgspec.Struct | None = None
    form: Mapping[str, str] | None = None
    files: Files | None = None
    key: str | None = None
    """Names the wish to the server; None: a new one is made where the method acts."""

    def headers(self) -> dict[str, str]:
        """Return the headers of the request; they are the same each time that it is sent."""
        found = {"Accept": "application/json"}
        if self.method in _ACTING:
            found[KEY_HEADER] = self.key or str(uuid.uuid4())
        if self.body is not None:
            found["Content-Type"] = "application/json"
        return found

    def params(self) -> list[tuple[str, str]]:
        """Return the parameters of the address; what is None is left out."""
        found = []
        for name, value in self.query.items():
            for one in value if isinstance(value, list | tuple) else [value]:
                if one is not None:
                    text = str(one).lower() if isinstance(one, bool) else str(one)
                    found.append((name, text))
        return found

    def content(self) -> bytes | None:
        """Return the body of the request."""
        return None if self.body is None else msgspec.json.encode(self.body)


class CallAttempts:
    """Sends one call again and again until its outcome is known; the sender waits in between."""

    def __init__(self, call: ApiCall, most_count: int) -> None:
        self.headers = call.headers()
        self._called = f"{call.method} {call.path}"
        self._most_count = most_count
        self._count = 0
        self._was_unanswered = False

    def unanswered(self, error: Exception) -> float:
        """Note that no answer came; return after how many seconds to send the call again.

        Raises:
            CallUnansweredError: It was sent often enough.
        """
        self._count += 1
        self._was_unanswered = True
        if self._count >= self._most_count:
            raise self._given_up(str(error)) from error
        return wait_s(self._count, 0, None, b"") or 0.0

    def answered(self, status: int, retry_after: str | None, content: bytes) -> float | None:
        """Note an answer; return after how many seconds to send the call again, None: do not.

        Raises:
            CallUnansweredError: It was sent often enough, and may have been carried out.
        """
        self._count += 1
        wanted = wait_s(self._count, status, retry_after, content)
        if wanted is None or self._count < self._most_count:
            return wanted
        if status == HTTPStatus.CONFLICT or self._was_unanswered:
            raise self._given_up(f"the last answer was {status}")
        return None

    def _given_up(self, why: str) -> CallUnansweredError:
        return CallUnansweredError(f"{self._called}: {why}", self.headers.get(KEY_HEADER))


def wait_s(attempt: int, status: int, retry_after: str | None, content: bytes) -> float | None:
    """Return after how many seconds a call is sent again; None: this answer is the last word.

    Args:
        attempt: How often it was sent, from 1.
        status: Of the answer; 0: none came.
        retry_after: What the server says of that.
        content: The answer.
    """
    is_in_progress = status == HTTPStatus.CONFLICT and _code(content) == _IN_PROGRESS
    if status and status not in _AGAIN and not is_in_progress:
        return None
    usual = _FIRST_WAIT_S * float(2 ** (attempt - 1))
    try:
        return min(_LONGEST_WAIT_S, max(usual, float(retry_after or 0)))
    except ValueError:
        return min(_LONGEST_WAIT_S, usual)


def read(status: int, content: bytes, answer: type[A]) -> A:
    """Return an answer.

    Args:
        status: Its status.
        content: Its body.
        answer: What it is read as: a struct, `bytes` of a file, or NoneType where none comes.

    Raises:
        CallRefusedError: The server refused the call.
    """
    if status >= HTTPStatus.MULTIPLE_CHOICES:
        raise CallRefusedError(status, _refusal(status, content))
    if answer is bytes:
        return cast("A", content)
    if answer is type(None):
        return None
    try:
        return msgspec.json.decode(content, type=answer)
    except msgspec.MsgspecError as error:
        text = f"the answer is not as this version of the client knows it: {error}"
        raise LabwebError(text) from error


def _refusal(status: int, content: bytes) -> ServerRefusal:
    try:
        return msgspec.json.decode(content, type=ServerRefusal)
    except msgspec.MsgspecError:
        text = content[:200].decode(errors="replace").strip() or "the server said nothing"
        return ServerRefusal(code=f"http.{status}", message=text)


def _code(content: bytes) -> str:
    try:
        return msgspec.json.decode(content, type=ServerRefusal).code
    except msgspec.MsgspecError:
        return ""
