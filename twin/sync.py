"""Follow the lab feed: connect, keep count, ask again, come back."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from labweb.domain.errors import DefinitionError
from twin.state import GapError, Message, TwinLabView

logger = logging.getLogger(__name__)

FEED_PATH = "/ws/v1/feed"
FIRST_WAIT_S = 0.5
LONGEST_WAIT_S = 8.0
STALE_AFTER_S = 1.0
"""The server sends at least twice a second; a silence of this length is no picture of now."""

_ALIVE_EVERY_S = 1.0
_MOST_BYTES = 64 * 1024 * 1024
_SILENCE_ENDS_S = 10.0

_decoder = msgspec.json.Decoder(Message)


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What `--config` names."""

    server_url: str
    """`ws://` or `wss://`, host and port."""

    token_file: str
    """Holds the service token; mode 0600."""


def read_config(path: Path) -> tuple[Config, str]:
    """Read the configuration and the token it names.

    Raises:
        DefinitionError: A file is missing, has another shape, or others may read the token.
    """
    try:
        config = msgspec.json.decode(path.read_bytes(), type=Config)
        token_file = Path(config.token_file)
        mode = token_file.stat().st_mode & 0o077
        token = token_file.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError, msgspec.DecodeError) as error:
        raise DefinitionError(f"the twin cannot start from {path}: {error}") from error
    if mode:
        raise DefinitionError(f"others may read the token in {token_file}: set its mode to 0600")
    if not token or not config.server_url.startswith(("ws://", "wss://")):
        raise DefinitionError(f"{path} needs a server_url of ws:// or wss:// and a token")
    return config, token


def next_wait_s(wait_s: float, chance: float) -> float:
    """Return how long to wait before the next try, for a backoff and a chance in 0 ≤ x < 1.

    Half of it is left to chance, so that many twins do not come back in one moment.
    """
    return wait_s * (0.5 + 0.5 * chance)


class FeedClient:
    """One twin's line to the server, for ever."""

    def __init__(
        self,
        config: Config,
        token: str,
        view: TwinLabView,
        alive: Callable[[], dict[str, Any]] | None,
    ) -> None:
        """Prepare; nothing is opened yet.

        Args:
            config: Where the server is.
            token: Service token; it travels in the header and nowhere else.
            view: What is kept up to date.
            alive: What to tell the server about this twin each second; None: it only listens,
                and nobody is sent to it.
        """
        self.view = view
        self._url = config.server_url.rstrip("/") + FEED_PATH
        self._headers = {"Authorization": f"Bearer {token}"}
        self._alive = alive
        self._heard_at: float | None = None
        self._is_waiting = False

    def silence_s(self) -> float | None:
        """Return how old the picture is; None while there was none yet."""
        return None if self._heard_at is None else time.monotonic() - self._heard_at

    async def run(self) -> None:
        """Follow the feed until cancelled."""
        wait_s = FIRST_WAIT_S
        while True:
            heard_before = self._heard_at
            try:
                await self._follow()
            except (OSError, TimeoutError, WebSocketException, msgspec.DecodeError) as error:
                logger.warning("the lab feed is away: %s", error)
            if self._heard_at != heard_before:
                wait_s = FIRST_WAIT_S
            await asyncio.sleep(next_wait_s(wait_s, random.random()))  # noqa: S311 - spreads load
            wait_s = min(wait_s * 2.0, LONGEST_WAIT_S)

    async def _follow(self) -> None:
        async with connect(
            self._url,
            additional_headers=self._headers,
            max_size=_MOST_BYTES,
            proxy=None,
            open_timeout=5,
        ) as line:
            logger.info("following %s", self._url)
            self._is_waiting = False
            beating = asyncio.create_task(self._tell(line))
            try:
                while True:
                    raw = await asyncio.wait_for(line.recv(), _SILENCE_ENDS_S)
                    await self._take(line, _decoder.decode(raw))
            finally:
                beating.cancel()
                with contextlib.suppress(asyncio.CancelledError, WebSocketException, OSError):
                    await beating

    async def _take(self, line: ClientConnection, message: Message) -> None:
        try:
            self.view.take(message)
        except GapError as gap:
            if not self._is_waiting:
                logger.warning("%s: asking for a snapshot", gap)
                self._is_waiting = True
                await line.send(json.dumps({"kind": "snapshot"}))
            return
        if message.kind == "snapshot":
            self._is_waiting = False
        self._heard_at = time.monotonic()

    async def _tell(self, line: ClientConnection) -> None:
        while self._alive is not None:
            await line.send(json.dumps({"kind": "alive", "data": self._alive()}))
            await asyncio.sleep(_ALIVE_EVERY_S)
