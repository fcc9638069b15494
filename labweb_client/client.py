"""A client that waits, and one for programs that are asynchronous."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import AbstractAsyncContextManager, AbstractContextManager
from typing import Any, Protocol, Self, TypeVar

import httpx

from labweb_client.errors import CallRefusedError, CallUnansweredError
from labweb_client.generated.models import RunDetail
from labweb_client.generated.operations import AsyncOperations, Operations
from labweb_client.live import News, follow, follow_async
from labweb_client.sending import API, ApiCall, CallAttempts, address_of, read

A = TypeVar("A")

_ENDED = frozenset({"complete", "aborted"})
_POLL_S = 1.0
_CONNECT_S = 10.0
_SERVER_FAILED = 500


class ListPage(Protocol):
    """An answer that is one page of a list."""

    @property
    def next(self) -> str | None:
        """Return what `after` takes for the next page; None: this is the last one."""


P = TypeVar("P", bound=ListPage)


class LabClient(Operations):
    """Talks to one server with an access token.

    Each call that acts carries a key of its own, and is sent again with the same key while no
    answer comes: it has one effect all the same.
    """

    def __init__(
        self,
        url: str,
        token: str,
        *,
        timeout_s: float = 240.0,
        attempts_count: int = 5,
        is_plain_allowed: bool = False,
    ) -> None:
        """Take the address of the server, such as `https://lab.example.org`, and a token.

        Args:
            url: Address of the server.
            token: Secret of an access token, as *Settings* has shown it.
            timeout_s: For how long one answer is waited for; a recipe may take minutes.
            attempts_count: How often a call is sent at most.
            is_plain_allowed: The token may cross the network unencrypted, by `http://`.

        Raises:
            ValueError: The address is none, or is `http://` to another machine.
        """
        self._url = address_of(url, is_plain_allowed=is_plain_allowed)
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

    def call(self, call: ApiCall, answer: type[A]) -> A:
        """Send a call until it is answered.

        Raises:
            CallRefusedError: The server refused it.
            CallUnansweredError: It was sent as often as is allowed, and no answer came.
        """
        found = self._send(call)
        return read(found.status_code, found.content, answer)

    def call_either(self, call: ApiCall, answers: Mapping[int, type[Any]]) -> Any:  # noqa: ANN401
        """Send a call until it is answered; the status says with which struct."""
        found = self._send(call)
        answer = answers.get(found.status_code, type(None))
        return read(found.status_code, found.content, answer)

    def _send(self, call: ApiCall) -> httpx.Response:
        attempts = CallAttempts(call, self._attempts_count)
        while True:
            try:
                found = self._http.request(**_request(call, attempts.headers))
            except httpx.TransportError as error:
                wanted = attempts.unanswered(error)
            else:
                after = found.headers.get("Retry-After")
                again = attempts.answered(found.status_code, after, found.content)
                if again is None:
                    return found
                wanted = again
            time.sleep(wanted)  # noqa: TID251 - there is no clock but the machine's

    def pages(self, fetch: Callable[..., P], **query: Any) -> Iterator[P]:  # noqa: ANN401
        """Yield every page of a list: `client.pages(client.get_runs, state="complete")`."""
        after: str | None = None
        while True:
            page = fetch(**query, after=after)
            yield page
            after = page.next
            if after is None:
                return

    def wait_for_run(self, run_id: str, *, timeout_s: float | None = None) -> RunDetail:
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

    def _look(self, run_id: str) -> RunDetail | None:
        """Return a run; None: the server is away, and the run goes on without it."""
        try:
            return self.get_run(run_id)
        except CallUnansweredError:
            return None
        except CallRefusedError as error:
            if error.status < _SERVER_FAILED:
                raise
            return None

    def follow(self, *topics: str) -> AbstractContextManager[Iterator[News]]:
        """Subscribe to topics such as `runs` or `run:<id>`: `with lab.follow("runs") as news:`."""
        return follow(self._url, self._token, topics)


class AsyncLabClient(AsyncOperations):
    """Talks to one server as `LabClient` does, from a program that is asynchronous."""

    def __init__(
        self,
        url: str,
        token: str,
        *,
        timeout_s: float = 240.0,
        attempts_count: int = 5,
        is_plain_allowed: bool = False,
    ) -> None:
        """Take address and token, as `LabClient` does."""
        self._url = address_of(url, is_plain_allowed=is_plain_allowed)
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

    async def call(self, call: ApiCall, answer: type[A]) -> A:
        """Send a call until it is answered, as `LabClient.call` does."""
        found = await self._send(call)
        return read(found.status_code, found.content, answer)

    async def call_either(
        self,
        call: ApiCall,
        answers: Mapping[int, type[Any]],
    ) -> Any:  # noqa: ANN401
        """Send a call until it is answered; the status says with which struct."""
        found = await self._send(call)
        answer = answers.get(found.status_code, type(None))
        return read(found.status_code, found.content, answer)

    async def _send(self, call: ApiCall) -> httpx.Response:
        attempts = CallAttempts(call, self._attempts_count)
        while True:
            try:
                found = await self._http.request(**_request(call, attempts.headers))
            except httpx.TransportError as error:
                wanted = attempts.unanswered(error)
            else:
                after = found.headers.get("Retry-After")
                again = attempts.answered(found.status_code, after, found.content)
                if again is None:
                    return found
                wanted = again
            await asyncio.sleep(wanted)

    async def pages(
        self,
        fetch: Callable[..., Awaitable[P]],
        **query: Any,  # noqa: ANN401 - what the list takes
    ) -> AsyncIterator[P]:
        """Yield every page of a list, as `LabClient.pages` does."""
        after: str | None = None
        while True:
            page = await fetch(**query, after=after)
            yield page
            after = page.next
            if after is None:
                return

    async def wait_for_run(self, run_id: str, *, timeout_s: float | None = None) -> RunDetail:
        """Return a run once it has ended, as `LabClient.wait_for_run` does."""
        async with asyncio.timeout(timeout_s):
            while True:
                run = await self._look(run_id)
                if run is not None and run.state in _ENDED:
                    return run
                await asyncio.sleep(_POLL_S)

    async def _look(self, run_id: str) -> RunDetail | None:
        try:
            return await self.get_run(run_id)
        except CallUnansweredError:
            return None
        except CallRefusedError as error:
            if error.status < _SERVER_FAILED:
                raise
            return None

    def follow(self, *topics: str) -> AbstractAsyncContextManager[AsyncIterator[News]]:
        """Subscribe as `LabClient.follow` does: `async with lab.follow("runs") as news:`."""
        return follow_async(self._url, self._token, topics)


def _patience(timeout_s: float) -> httpx.Timeout:
    return httpx.Timeout(timeout_s, connect=min(timeout_s, _CONNECT_S))


def _request(call: ApiCall, headers: dict[str, str]) -> dict[str, Any]:
    return {
        "method": call.method,
        "url": API + call.path,
        "params": call.params(),
        "headers": headers,
        "content": call.content(),
        "data": call.form,
        "files": call.files,
    }
