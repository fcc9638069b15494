"""Looks what source that nobody approved can reach: `python -m tests.workers.tryouts.tryout_probe`.

Arguments: the address of its line, a file of the host, a port of another service.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
from collections.abc import Callable

from workers.tryouts.driver_process import limit


def main() -> None:
    """Print what works, by name."""
    url, secret, other = sys.argv[1:]
    port = int(url.rpartition(":")[2]) if url.startswith("tcp:") else 0
    line = url.removeprefix("serial://")
    limit(url)
    found: dict[str, bool] = {}

    def attempt(name: str, work: Callable[[], object]) -> None:
        try:
            work()
        except (OSError, MemoryError):
            found[name] = False
        else:
            found[name] = True

    attempt("own line", lambda: reach(line, port))
    attempt("thread", lambda: threading.Thread(target=str).start())
    attempt("other port", lambda: socket.create_connection(("127.0.0.1", int(other))))
    attempt("file of the host", lambda: open(secret, "rb"))  # noqa: PTH123, SIM115
    attempt("passwords", lambda: open("/etc/passwd", "rb"))  # noqa: PTH123, SIM115
    attempt("new file", lambda: open("/tmp/lw-probe", "w"))  # noqa: PTH123, SIM115
    attempt("listening", lambda: socket.create_server(("127.0.0.1", 0)))
    attempt("datagrams", lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    attempt("local socket", lambda: socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
    attempt(
        "pair for another local socket",
        lambda: socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM),
    )
    attempt("listening at any port", lambda: socket.socket().listen())
    attempt("fork", os.fork)
    attempt("program", lambda: os.posix_spawn("/bin/true", ["true"], {}))
    attempt("signal to its parent", lambda: os.kill(os.getppid(), 0))
    attempt("three gigabytes", lambda: bytearray(3 * 1024**3))
    sys.stdout.write(json.dumps(found))
    sys.stdout.flush()
    os._exit(0)


def reach(line: str, port: int) -> None:
    """Open the own line as a transport does."""
    if port:
        socket.create_connection(("127.0.0.1", port)).close()
    else:
        os.close(os.open(line, os.O_RDWR | os.O_NOCTTY))


if __name__ == "__main__":
    main()
