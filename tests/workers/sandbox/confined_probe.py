"""Confine this process as a line's, try what a driver must not, and print what succeeded.

`python probe.py CONFIG LINE DEVICE-JSON OTHER-FILE OTHER-PORT`
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from labweb.domain.messages.devices_and_drivers import DeviceConfig
from workers.base.config import load_config
from workers.base.wake_pipe import WakePipe, hang, ring
from workers.journal.journal import Journal
from workers.line.driver_store import DriverStore
from workers.line.line_confinement import confine_line

OTHER_LINE = "serial:/dev/other"
"""A line whose bell somebody listens for."""


def works(act: Callable[[], object]) -> bool:
    try:
        act()
    except OSError:
        return False
    return True


def connect(port: int, host: str = "127.0.0.1") -> None:
    socket.create_connection((host, port), timeout=5.0).close()


def listen() -> None:
    with socket.socket() as one:
        one.listen()


def write_journal(path: Path) -> None:
    journal = Journal(path)
    with journal.write() as tx:
        tx.append("boot", None, {"boot_id": "probe"})
    journal.close()


def ring_or_fail(path: Path) -> None:
    if not ring(path):
        raise OSError(path)


def ptrace_parent() -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.ptrace(16, os.getppid(), None, None) != 0:
        raise OSError(ctypes.get_errno(), "ptrace")


def main() -> None:
    config_path, line = Path(sys.argv[1]), sys.argv[2]
    device = msgspec.json.decode(sys.argv[3], type=DeviceConfig)
    other_file, other_port = Path(sys.argv[4]), int(sys.argv[5])
    config = load_config(config_path)
    own_port = int(device.transport.rpartition(":")[2])
    assert confine_line(config, line, [device])
    store = DriverStore(config.drivers_folder)
    found = {
        "own bundle": works(lambda: store.path(device.digest).read_bytes()),
        "own journal": works(lambda: write_journal(config.journal_path)),
        "own device": works(lambda: connect(own_port)),
        "code of the release": works(lambda: __import__("drivers.processing.huber_pb")),
        "own bell": works(lambda: WakePipe(config.bell_of(line)).close()),
        "ringing another line": works(lambda: ring_or_fail(config.bell_of(OTHER_LINE))),
        "hearing another line's bell": works(lambda: WakePipe(config.bell_of(OTHER_LINE))),
        "another bell": works(lambda: hang(config.bells_path / "x")),
        "file beside the bells": works(lambda: (config.bells_path / "y").write_text("y")),
        "another driver's file": works(other_file.read_bytes),
        "list of drivers": works(lambda: list(config.drivers_folder.iterdir())),
        "key of the host": works(Path(config.key_file).read_bytes),
        "configuration": works(config_path.read_bytes),
        "passwords of the machine": works(Path("/etc/passwd").read_bytes),
        "new file": works(lambda: (config.folder / "x").write_text("x")),
        "temporary file": works(lambda: Path("/tmp/labweb-probe").write_text("x")),
        "another device": works(lambda: os.close(os.open("/dev/ptmx", os.O_RDWR))),
        "another port": works(lambda: connect(other_port)),
        "another address at the same port": works(lambda: connect(own_port, "127.0.0.2")),
        "listening": works(lambda: socket.create_server(("127.0.0.1", 0)).close()),
        "listening at any port": works(listen),
        "datagrams": works(lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).close()),
        "raw packets": works(lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW).close()),
        "a program": works(lambda: subprocess.run(["/bin/true"], check=True)),
        "the parent's memory": works(ptrace_parent),
        "a signal to the parent": works(lambda: os.kill(os.getppid(), 0)),
        "bounds of the parent": works(lambda: resource.prlimit(os.getppid(), resource.RLIMIT_CPU)),
        "priority of the parent": works(lambda: os.setpriority(os.PRIO_PROCESS, os.getppid(), 19)),
        "processors of the parent": works(
            lambda: os.sched_setaffinity(os.getppid(), os.sched_getaffinity(os.getppid()))
        ),
    }
    sys.stdout.write(json.dumps(found))


if __name__ == "__main__":
    main()
