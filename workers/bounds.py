"""What the devices of one line may reach, from their addresses and the host's own files."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

from cryptography import x509

from drivers.transports.urls import file_of, line_key, ports_of
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
    """Return what a line needs: journal, lock, bundles, its files, its own port or address."""
    journal = config.journal_path
    own = [journal, *(journal.with_name(journal.name + end) for end in ("-wal", "-shm"))]
    own += [journal.with_suffix(".seal"), journal.with_suffix(".bell")]
    own += [config.folder / f"{line_queue(line)}.lock"]
    store = DriverStore(config.drivers_folder)
    has_ros2 = any(device.transport.startswith("ros2:") for device in devices)
    ports = [port for device in devices for port in ports_of(device.transport)]
    if config.valkey.url is not None:
        ports.append(urlsplit(config.valkey.url).port or 6379)
    return Bounds(
        readable=existing([*(store.path(device.digest) for device in devices), *_read(devices)]),
        writable=existing([*own, *device_files(devices)]),
        folders=existing([config.files_of(line)]),
        ports=tuple(sorted(set(ports))),
        has_datagrams=any("beat=" in device.transport for device in devices) or has_ros2,
        has_interfaces=has_ros2,
    )


def bounds_of_address(url: str) -> Bounds:
    """Return what a driver needs that is tried on one address, and nothing of the host's own."""
    return Bounds(
        readable=existing(_public_files([url])),
        writable=existing(_files([url])),
        ports=tuple(sorted(set(ports_of(url)))),
        has_local=False,
        has_processes=False,
        has_datagrams="beat=" in url,
    )


def _read(devices: Sequence[DeviceConfig]) -> list[Path]:
    """Return the certificates of devices; a file that holds anything else is not theirs to read."""
    return _public_files([device.transport for device in devices])


def _public_files(urls: Sequence[str]) -> list[Path]:
    files = [file_of(url) for url in urls]
    return [Path(file) for file in files if file is not None and _is_public(Path(file))]


def _is_public(path: Path) -> bool:
    """Tell whether a file holds certificates and no key."""
    try:
        content = path.read_bytes()
        x509.load_pem_x509_certificates(content)
    except (OSError, ValueError) as error:
        log.warning("%s is no certificate, so that no driver may read it: %s", path, error)
        return False
    if b"PRIVATE KEY" in content:
        log.warning("%s holds a private key, so that no driver may read it", path)
        return False
    return True


def device_files(devices: Sequence[DeviceConfig]) -> list[Path]:
    """Return the serial ports and GPIB boards of devices."""
    return _files([device.transport for device in devices])


def _files(urls: Sequence[str]) -> list[Path]:
    lines = [line_key(url).partition(":") for url in urls]
    folder = {"serial": "", "gpib": "/dev/gpib"}
    return [Path(f"{folder[sort]}{place}") for sort, _, place in lines if sort in folder]


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
