"""A server on a real port, for tests that need a browser's or a twin's own connection."""

from __future__ import annotations

from dataclasses import dataclass, field

import httpx
from django.core.cache import cache
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from labweb.api.twin.feed import ALIVE_KEY
from tests.builders import PASSWORD, Bench

VISER = Subprotocol("viser-v1.1.1")


@dataclass
class Site:
    """A server that listens, with its lab."""

    port: int
    bench: Bench
    clients: list[httpx.Client] = field(default_factory=list)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def client(self, username: str | None = "observer") -> httpx.Client:
        """Give a browser, signed in unless nobody is named."""
        client = httpx.Client(base_url=self.url, trust_env=False)
        self.clients.append(client)
        client.get("/api/v1/session")
        if username is not None:
            answer = client.post(
                "/api/v1/session",
                json={"username": username, "password": PASSWORD},
                headers=self.csrf(client),
            )
            assert answer.status_code == 200, answer.text
        return client

    def csrf(self, client: httpx.Client) -> dict[str, str]:
        return {"X-CSRFToken": client.cookies["csrftoken"]}

    def line(
        self, client: httpx.Client, path: str = "/twin/view", origin: str | None = None
    ) -> connect:
        """Open a websocket as a page of this browser."""
        cookies = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
        return connect(
            f"ws://127.0.0.1:{self.port}{path}",
            additional_headers={"Cookie": cookies},
            origin=origin or self.url,  # type: ignore[arg-type]
            subprotocols=[VISER],
            proxy=None,
        )


def there_is_a_twin_at(port: int) -> None:
    """Say what a twin would say, for longer than it holds."""
    said = {"ports": {"light": port, "dark": port}, "is_fresh": True, "clients_count": 0}
    cache.set(ALIVE_KEY, said, 60)
