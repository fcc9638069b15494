"""What every test gets: no way out of this machine, and examples that come again."""

from __future__ import annotations

import gc
import ipaddress
import os
import socket
from collections.abc import Callable, Generator, Iterator
from typing import Any

import pytest
from hypothesis import settings

settings.register_profile("here", deadline=None, print_blob=True)
settings.register_profile("ci", deadline=None, print_blob=True, derandomize=True)
settings.register_profile("soak", deadline=None, print_blob=True, max_examples=2000)
if os.environ.get("LABWEB_SOAK"):
    settings.load_profile("soak")
else:
    settings.load_profile("ci" if os.environ.get("CI") else "here")

INTERNET = (socket.AF_INET, socket.AF_INET6)


def is_on_this_machine(address: object) -> bool:
    """Say whether a socket address or host name stays on the loopback interface."""
    host = address[0] if isinstance(address, tuple) else address
    if host is None or host in ("", b"", "localhost", b"localhost"):
        return True
    text = host.decode("ascii", "replace") if isinstance(host, bytes) else str(host)
    try:
        found = ipaddress.ip_address(text.partition("%")[0])
    except ValueError:
        return False
    return found.is_loopback or found.is_unspecified


def pytest_collection_finish() -> None:
    """Keep the collector of cycles from walking what was loaded: it took a sixth of all time.

    What tests make is looked at as often as before, so that a leak is still told of.
    """
    gc.collect()
    gc.freeze()


def _refuse(address: object) -> None:
    raise PermissionError(f"tests stay on this machine: {address!r} is outside it")


def _guarded(real: Callable[..., Any]) -> Callable[..., Any]:
    def call(sock: socket.socket, address: Any) -> Any:  # noqa: ANN401 - as in socket
        if sock.family in INTERNET and not is_on_this_machine(address):
            _refuse(address)
        return real(sock, address)

    return call


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Put beside a failure what the processes of its lab said."""
    report = yield
    tell = getattr(getattr(item, "funcargs", {}).get("stack"), "told", None)
    if report.failed and call.when == "call" and tell is not None:
        report.sections.append(("the lab", tell()))
    return report


@pytest.fixture(scope="session", autouse=True)
def no_network() -> Iterator[None]:
    """Let sockets reach loopback and unix sockets, and nothing else."""
    real_lookup = socket.getaddrinfo

    def look_up(host: Any, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401 - as in socket
        if not is_on_this_machine(host):
            _refuse(host)
        return real_lookup(host, *args, **kwargs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket.socket, "connect", _guarded(socket.socket.connect))
        patch.setattr(socket.socket, "connect_ex", _guarded(socket.socket.connect_ex))
        patch.setattr(socket, "getaddrinfo", look_up)
        yield
