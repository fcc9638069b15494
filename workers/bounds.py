"""What the devices of one line may reach, from their addresses and the host's own files."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

from labweb.domain.messages import DeviceConfig
from workers import faults
from workers.config import HostConfig, line_queue
from workers.confine import Bounds, confine, describe, existing, is_possible
from workers.drivers import DriverStore

log = logging.getLogger(__name__)


def confine_line(config: HostConfig, line: str, devices: Sequence[DeviceConfig]) -> bool:
    """Confine this process to what the devices of its line need; False: it stays unconfined.

    A host that was told to accept it goes on unconfined where the kernel cannot; faults for
    tests, which reach into files and kernel, are never confined.

    Raises:
        StateError: It must be confined, and cannot.
    """
    if faults.are_armed() or (not is_possible() and config.accepts_unconfined):
        why = "faults are armed" if faults.are_armed() else describe()
        log.warning("line %s is unconfined: %s", line, why)
        return False
    confine(bounds_of(config, line, devices))
    return True


def bounds_of(config: HostConfig, line: str, devices: Sequence[DeviceConfig]) -> Bounds:
    """Return what a line needs: journal, lock, bundles, its own port or address."""
    journal = config.journal_path
    own = [journal, *(journal.with_name(journal.name + end) for end in ("-wal", "-shm"))]
    own += [journal.with_suffix(".seal"), journal.with_suffix(".bell")]
    own += [config.folder / f"{line_queue(line)}.lock"]
    store = DriverStore(config.drivers_folder)
    has_ros2 = any(device.transport.startswith("ros2:") for device in devices)
    ports = [_port(device.transport) for device in devices]
    if config.valkey.url is not None:
        ports.append(urlsplit(config.valkey.url).port or 6379)
    return Bounds(
        readable=existing(store.path(device.digest) for device in devices),
        writable=existing([*own, *device_files(devices)]),
        ports=tuple(sorted({port for port in ports if port is not None})),
        has_datagrams=any("beat=" in device.transport for device in devices) or has_ros2,
        has_interfaces=has_ros2,
    )


def device_files(devices: Sequence[DeviceConfig]) -> list[Path]:
    """Return the serial ports of devices."""
    urls = [urlsplit(device.transport) for device in devices]
    return [Path(url.path) for url in urls if url.scheme.endswith("serial")]


def marks_of(devices: Sequence[DeviceConfig]) -> str:
    """Return a text that changes when a serial port is another file than before.

    A port that was unplugged comes back as another file, which a confined line cannot open.
    """
    marks = []
    for path in device_files(devices):
        try:
            found = path.stat()
            marks.append(f"{path}:{found.st_dev}:{found.st_ino}:{found.st_rdev}")
        except OSError:
            marks.append(f"{path}:none")
    return " ".join(marks)


def _port(url: str) -> int | None:
    parts = urlsplit(url)
    if not parts.scheme.endswith("tcp"):
        return None
    return parts.port
