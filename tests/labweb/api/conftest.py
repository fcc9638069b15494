"""The starter lab behind a real port."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator

import pytest
import uvicorn

from labweb.api.routing import application
from tests.builders import a_lab
from tests.labweb.api.twin_site import Site
from tests.services import Services


@pytest.fixture
def site(services: Services, transactional_db: None) -> Iterator[Site]:
    """Serve the starter lab on a real port."""
    bench = a_lab()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    config = uvicorn.Config(
        application(), host="127.0.0.1", port=port, log_level="warning", lifespan="off",
        timeout_graceful_shutdown=2,
    )  # fmt: skip
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    pause = threading.Event()
    while not server.started:
        assert thread.is_alive()
        pause.wait(0.02)
    found = Site(port, bench)
    yield found
    for client in found.clients:
        client.close()
    server.should_exit = True
    thread.join(10)
