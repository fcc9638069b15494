"""Who a request comes from, and for how long it may not be read."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from labweb.api.outermost_layer import bounded, caller_of, name_of, with_borders

PROXY = "10.0.0.2"


def a_scope(peer: str | None, *forwarded: str) -> dict[str, Any]:
    headers = [(b"x-forwarded-for", value.encode("latin-1")) for value in forwarded]
    return {"client": None if peer is None else (peer, 1234), "headers": headers}


@pytest.mark.parametrize("trusted", [[], ["10.9.0.0/16"], ["unix"]])
def test_a_stranger_does_not_choose_the_address_that_is_counted(trusted: list[str]) -> None:
    assert caller_of(a_scope("127.0.0.1", "192.0.2.7"), trusted) == "127.0.0.1"


@pytest.mark.parametrize(
    ("forwarded", "wanted"),
    [
        (["192.0.2.7"], "192.0.2.7"),
        (["198.51.100.1, 192.0.2.7"], "192.0.2.7"),
        (["198.51.100.1", "192.0.2.7, 10.0.0.3"], "192.0.2.7"),
        (["192.0.2.7:4711"], "192.0.2.7"),
        (["[2001:db8::1]:4711"], "2001:db8::1"),
        (["192.0.2.7, nonsense"], PROXY),
        ([], PROXY),
    ],
)
def test_behind_a_trusted_proxy_it_is_the_first_hop_from_the_right_that_is_none(
    forwarded: list[str], wanted: str
) -> None:
    assert caller_of(a_scope(PROXY, *forwarded), ["10.0.0.0/24"]) == wanted


def test_a_proxy_on_a_unix_socket_is_trusted_by_name() -> None:
    assert caller_of(a_scope(None, "192.0.2.7"), ["unix"]) == "192.0.2.7"
    assert caller_of(a_scope(None, "192.0.2.7"), []) == "unix"


def test_the_addresses_of_one_network_of_ipv6_are_one_caller() -> None:
    assert name_of("2001:db8::1") == name_of("2001:db8::ffff:2")
    assert name_of("2001:db8::1") != name_of("2001:db8:0:1::1")
    assert name_of("::ffff:192.0.2.7") == name_of("192.0.2.7")


class Transport(asyncio.Transport):
    """The end of a connection whose other end never reads."""

    is_aborted = False

    def abort(self) -> None:
        self.is_aborted = True


class Cycle:
    """What a server hands to the application: `send` of an object that has the transport."""

    def __init__(self) -> None:
        self.transport = Transport()

    async def send(self, message: object) -> None:
        del message
        await asyncio.Event().wait()


async def test_who_does_not_read_is_cut_off_and_the_application_goes_on() -> None:
    cycle = Cycle()
    await bounded(cycle.send, 0.01)({"type": "http.response.body"})
    assert cycle.transport.is_aborted


async def test_the_application_is_told_the_true_address(settings: Any) -> None:  # noqa: ANN401
    settings.TRUSTED_PROXIES = [PROXY]
    seen: list[Any] = []

    async def inner(scope: Any, receive: Any, send: Any) -> None:  # noqa: ANN401 - ASGI
        del receive, send
        seen.append(scope["client"][0])

    async def nothing(*_: object) -> Any:  # noqa: ANN401 - ASGI
        return {}

    scope = {"type": "http", **a_scope(PROXY, "192.0.2.7")}
    await with_borders(inner)(scope, nothing, nothing)
    assert seen == ["192.0.2.7"]
