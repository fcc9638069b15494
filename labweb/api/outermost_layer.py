"""The outermost layer of the server: who is calling, and how long sending may take."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

from django.conf import settings

logger = logging.getLogger(__name__)

Scope = Any
Message = Mapping[str, Any]
Send = Callable[[Message], Awaitable[None]]
Receive = Callable[[], Awaitable[Message]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

UNIX = "unix"
"""Name of a caller that came by a unix socket and has no address."""

_IPV6_HOST_BITS = 64


def with_borders(inner: Application) -> Application:
    """Put the true address of the caller into the scope, and cut off who does not read."""

    async def application(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await inner(scope, receive, send)
            return
        known = {**scope, "client": (caller_of(scope, settings.TRUSTED_PROXIES), 0)}
        await inner(known, receive, bounded(send, settings.SEND_WITHIN_S))

    return application


def bounded(send: Send, within_s: float) -> Send:
    """Return a `send` that ends the connection when the client takes nothing for so long.

    The connection is aborted: closed in order, it would wait for the client to read what is left.
    The application then hears that the client is gone, as it does of any other.
    """

    async def send_in_time(message: Message) -> None:
        try:
            async with asyncio.timeout(within_s):
                await send(message)
        except TimeoutError:
            logger.warning("a client took nothing for %g s: it is cut off", within_s)
            transport = getattr(getattr(send, "__self__", None), "transport", None)
            if not isinstance(transport, asyncio.Transport):
                raise
            transport.abort()

    return send_in_time


def caller_of(scope: Scope, trusted: Sequence[str]) -> str:
    """Return the address a request comes from.

    `X-Forwarded-For` is read from the right, and only as far as each hop is a trusted proxy: what
    stands left of the first that is none was written by whoever called it.

    Source:
        RFC 7239, section 8.1: the header is no evidence but for what a trusted proxy added.
    """
    client = scope.get("client")
    peer = str(client[0]) if client and client[0] else UNIX
    told = [value for name, value in scope["headers"] if name == b"x-forwarded-for"]
    hops = [hop.strip() for hop in b",".join(told).decode("latin-1").split(",") if hop.strip()]
    while hops and _is_trusted(peer, trusted):
        hop = _address(hops.pop())
        if hop is None:
            return peer
        peer = str(hop)
    return peer


def name_of(address: str) -> str:
    """Return the name under which an address is counted: a network of IPv6 is one caller.

    Source:
        RFC 6177: a site is given a /64 or more, whose addresses it may choose among freely.
    """
    found = _address(address)
    if isinstance(found, ipaddress.IPv6Address):
        if found.ipv4_mapped is not None:
            return f"address:{found.ipv4_mapped}"
        return f"address:{ipaddress.ip_network((found, _IPV6_HOST_BITS), strict=False)}"
    return f"address:{address}"


def _is_trusted(peer: str, trusted: Sequence[str]) -> bool:
    if peer == UNIX:
        return UNIX in trusted
    address = _address(peer)
    networks = [ipaddress.ip_network(one, strict=False) for one in trusted if one != UNIX]
    return address is not None and any(address in network for network in networks)


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Read an address, with a port or in brackets as proxies write it; None: it is none."""
    plain = text.partition("]")[0].removeprefix("[") if text.startswith("[") else text
    if plain.count(":") == 1:
        plain = plain.partition(":")[0]
    try:
        return ipaddress.ip_address(plain)
    except ValueError:
        return None
