"""What one edge host is told about itself, in `host.json`."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal
from urllib.parse import quote
from uuid import UUID

import msgspec

from labweb.domain.errors import DefinitionError
from workers import faults

LONGEST_SOCKET_PATH = 100
"""Bytes; the kernel's limit for a unix socket is 108."""


class ValkeyConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The host's own broker: one it starts on a unix socket, or one that runs already."""

    socket: str | None = None
    url: str | None = None


class HostConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One edge host."""

    host_id: UUID
    name: str
    server_url: str
    """`ws://` or `wss://` address of the server, without path."""

    broker_url: str
    """Celery address of the server's broker."""

    data_dir: str
    key_file: str
    valkey: ValkeyConfig
    mode: Literal["sim", "live"] = "sim"
    stop_grace_s: float = 2.0
    """How long a running action may go on after the first request to end."""

    retention_s: float = 30 * 86400.0
    """How long acknowledged events are kept."""

    log_level: str = "INFO"
    faults: str | None = None
    """Fault to inject, `point:kill`; for tests of crashes only."""

    @property
    def folder(self) -> Path:
        """Return the folder that holds journal, seal and locks."""
        return Path(self.data_dir)

    @property
    def journal_path(self) -> Path:
        """Return where the journal lies."""
        return self.folder / "journal.sqlite3"

    @property
    def valkey_url(self) -> str:
        """Return the host's own Valkey in the form that redis-py reads."""
        if self.valkey.socket is not None:
            return f"unix://{quote(self.valkey.socket)}?db=0"
        return self.valkey.url or ""

    @property
    def host_broker_url(self) -> str:
        """Return the host's own broker in the form that Celery reads."""
        if self.valkey.socket is not None:
            return f"redis+socket://{quote(self.valkey.socket)}?virtual_host=1"
        return self.valkey.url or ""

    @property
    def uplink_url(self) -> str:
        """Return the address of the server's end of the uplink."""
        return f"{self.server_url.rstrip('/')}/ws/edge/v1/"


def load_config(path: Path) -> HostConfig:
    """Read `host.json`.

    Raises:
        DefinitionError: It is missing, malformed, or contradicts itself.
    """
    try:
        config = msgspec.json.decode(path.read_bytes(), type=HostConfig)
    except OSError as exc:
        raise DefinitionError(f"cannot read the host's configuration {path}: {exc}") from exc
    except msgspec.MsgspecError as exc:
        raise DefinitionError(f"{path} is no host configuration: {exc}") from exc
    _check(config, path)
    return config


def _check(config: HostConfig, path: Path) -> None:
    valkey = config.valkey
    if (valkey.socket is None) == (valkey.url is None):
        raise DefinitionError(f"{path}: valkey needs either a socket or a url")
    if valkey.socket is not None and len(valkey.socket.encode()) > LONGEST_SOCKET_PATH:
        raise DefinitionError(f"{path}: the socket's path is longer than {LONGEST_SOCKET_PATH}")
    if not config.server_url.startswith(("ws://", "wss://")):
        raise DefinitionError(f"{path}: server_url must begin with ws:// or wss://")
    if config.mode == "live" and (config.faults is not None or faults.are_wanted()):
        raise DefinitionError(f"{path}: a live host injects no faults; unset LABWEB_FAULTS")
    if config.stop_grace_s < 0:
        raise DefinitionError(f"{path}: stop_grace_s may not be negative")


def command_queue(host_id: UUID) -> str:
    """Return the queue on the server's broker that belongs to one host alone."""
    return f"edge.{host_id}.cmd"


def line_queue(line: str) -> str:
    """Return the queue on the host's own broker that wakes one line."""
    return f"line.{hashlib.sha256(line.encode()).hexdigest()[:12]}"
