"""A client that waits, and one for programs that are asynchronous."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from typing import Any, Protocol, Self, TypeVar

import httpx

from labweb_client.errors import RefusedError, UnansweredError
from labweb_client.generated.models import RunView
from labweb_client.generated.operations import AsyncOperations, Operations
from labweb_client.live import News, follow, follow_async
from labweb_client.sending import API, KEY_HEADER, Call, is_undecided, read, wait_s

A = TypeVar("A")

_ENDED = frozenset({"complete", "aborted"})
_POLL_S = 1.0
_CONNECT_S = 10.0
_SERVER_FAILED = 500


class Page(Protocol):
    """An answer that is one page of a list."""

    @property
    def next(self) -> str | None:
        """Return what `after` takes for the next page; None: this is the last one."""


P = TypeVar("P", bound=Page)


class Client(Operations):
    """Talks to one server with an access token.

    Each call that acts carries a key of its own, and is sent again with the same key while no
    answer comes: it has one effect all the same.
    """

    def __init__(
        self, url: str, token: str, *, timeout_s: float = 240.0, attempts_count: int = 5
    ) -> None:
        """Take the address of the server, such as `https://lab.example.org`, and a token.

        Args:
            url: Address of the server.
            token: Secret of an access token, as *Settings* has shown it.
            timeout_s: For how long one answer is waited for; a recipe may take minutes.
            attempts_count: How often a call is sent at most.
        """
        self._url = url.rstrip("/")
        self._token = token
        self._attempts_count = attempts_count
        headers = {"Authorization": f"Bearer {token}"}
        self._http = httpx.Client(base_url=self._url, headers=headers, timeout=_patience(timeout_s))

    def __enter__(self) -> Self:
        """Return the client."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close its connections."""
        self._http.close()

    def call(self, call: Call, answer: type[A]) -> A:
        """Send a call until it is answered.

        Raises:
            RefusedError: The server refused it.
            UnansweredError: It was sent as often as is allowed, and no answer came.
        """
        found = self._send(call)
        return read(found.status_code, found.content, answer)

    def call_either(self, call: Call, answers: Mapping[int, type[Any]]) -> Any:  # noqa: ANN401
        """Send a call until it is answered; the status says with which struct."""
        found = self._send(call)
        answer = answers.get(found.status_code, type(None))
        return read(found.status_code, found.content, answer)

    def _send(self, call: Call) -> httpx.Response:
        headers, attempt, was_unanswered = call.headers(), 0, False
        while True:
            attempt += 1
            is_last = attempt >= self._attempts_count
            try:
                found = self._http.request(**_request(call, headers))
            except httpx.TransportError as error:
                was_unanswered = True
                if is_last:
                    raise _unanswered(call, headers, str(error)) from error
                wanted = wait_s(attempt, 0, None, b"")
            else:
                after = found.headers.get("Retry-After")
                wanted = wait_s(attempt, found.status_code, after, found.content)
                status, content = found.status_code, found.content
                if is_last and is_undecided(status, content, was_unanswered=was_unanswered):
                    raise _unanswered(call, headers, f"the last answer was {status}")
                if wanted is None or is_last:
                    return found
            time.sleep(wanted or 0.0)  # noqa: TID251 - there is no clock but the machine's

    def pages(self, fetch: Callable[..., P], **query: Any) -> Iterator[P]:  # noqa: ANN401
        """Yield every page of a list: `client.pages(client.get_runs, state="complete")`."""
        after: str | None = None
        while True:
            page = fetch(**query, after=after)
            yield page
            after = page.next
            if after is None:
                return

    def wait_for_run(self, run_id: str, *, timeout_s: float | None = None) -> RunView:
        """Return a run once it has ended.

        Raises:
            TimeoutError: It goes on after that time; it is not aborted.
        """
        until = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            run = self._look(run_id)
            if run is not None and run.state in _ENDED:
                return run
            if until is not None and time.monotonic() > until:
                raise TimeoutError(f"the run has not ended after {timeout_s} s")
            time.sleep(_POLL_S)  # noqa: TID251 - as above

    def _look(self, run_id: str) -> RunView | None:
        """Return a run; None: the server is away, and the run goes on without it."""
        try:
            return self.get_run(run_id)
        except UnansweredError:
            return None
        except RefusedError as error:
            if error.status < _SERVER_FAILED:
                raise
            return None

    def follow(self, *topics: str) -> Iterator[News]:
        """Yield what the server announces on topics such as `runs` or `run:<id>`."""
        return follow(self._url, self._token, topics)


class AsyncClient(AsyncOperations):
    """Talks to one server as `Client` does, from a program that is asynchronous."""

    def __init__(
        self, url: str, token: str, *, timeout_s: float = 240.0, attempts_count: int = 5
    ) -> None:
        """Take address and token, as `Client` does."""
        self._url = url.rstrip("/")
        self._token = token
        self._attempts_count = attempts_count
        headers = {"Authorization": f"Bearer {token}"}
        self._http = httpx.AsyncClient(
            base_url=self._url, headers=headers, timeout=_patience(timeout_s)
        )

    async def __aenter__(self) -> Self:
        """Return the client."""
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close its connections."""
        await self._http.aclose()

    async def call(self, call: Call, answer: type[A]) -> A:
        """Send a call until it is answered, as `Client.call` does."""
        found = await self._send(call)
        return read(found.status_code, found.content, answer)

    async def call_either(
        self,
        call: Call,
        answers: Mapping[int, type[Any]],
    ) -> Any:  # noqa: ANN401
        """Send a call until it is answered; the status says with which struct."""
        found = await self._send(call)
        answer = answers.get(found.status_code, type(None))
        return read(found.status_code, found.content, answer)

    async def _send(self, call: Call) -> httpx.Response:
        headers, attempt, was_unanswered = call.headers(), 0, False
        while True:
            attempt += 1
            is_last = attempt >= self._attempts_count
            try:
                found = await self._http.request(**_request(call, headers))
            except httpx.TransportError as error:
                was_unanswered = True
                if is_last:
                    raise _unanswered(call, headers, str(error)) from error
                wanted = wait_s(attempt, 0, None, b"")
            else:
                after = found.headers.get("Retry-After")
                wanted = wait_s(attempt, found.status_code, after, found.content)
                status, content = found.status_code, found.content
                if is_last and is_undecided(status, content, was_unanswered=was_unanswered):
                    raise _unanswered(call, headers, f"the last answer was {status}")
                if wanted is None or is_last:
                    return found
            await asyncio.sleep(wanted or 0.0)

    async def pages(
        self,
        fetch: Callable[..., Awaitable[P]],
        **query: Any,  # noqa: ANN401 - what the list takes
    ) -> AsyncIterator[P]:
        """Yield every page of a list, as `Client.pages` does."""
        after: str | None = None
        while True:
            page = await fetch(**query, after=after)
            yield page
            after = page.next
            if after is None:
                return

    async def wait_for_run(self, run_id: str, *, timeout_s: float | None = None) -> RunView:
        """Return a run once it has ended, as `Client.wait_for_run` does."""
        async with asyncio.timeout(timeout_s):
            while True:
                run = await self._look(run_id)
                if run is not None and run.state in _ENDED:
                    return run
                await asyncio.sleep(_POLL_S)

    async def _look(self, run_id: str) -> RunView | None:
        try:
            return await self.get_run(run_id)
        except UnansweredError:
            return None
        except RefusedError as error:
            if error.status < _SERVER_FAILED:
                raise
            return None

    def follow(self, *topics: str) -> AsyncIterator[News]:
        """Yield what the server announces, as `Client.follow` does."""
        return follow_async(self._url, self._token, topics)


def _patience(timeout_s: float) -> httpx.Timeout:
    return httpx.Timeout(timeout_s, connect=min(timeout_s, _CONNECT_S))


def _unanswered(call: Call, headers: dict[str, str], why: str) -> UnansweredError:
    key = headers.get(KEY_HEADER)
    return UnansweredError(f"{call.method} {call.path}: {why}", key)


def _request(call: Call, headers: dict[str, str]) -> dict[str, Any]:
    return {
        "method": call.method,
        "url": API + call.path,
        "params": call.params(),
        "headers": headers,
        "content": call.content(),
        "data": call.form,
        "files": call.files,
    }
