"""What the devices of one line may reach, from their addresses and the host's own files."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

from cryptography import x509

from drivers.transports.http import TOKEN
from drivers.transports.urls import addresses_of, beat_of, file_of, line_key, ros2_of
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from workers import faults
from workers.config import HostConfig, line_queue
from workers.confine import Bounds, confine, describe, existing, is_possible
from workers.datagrams import Segment
from workers.drivers import DriverStore
from workers.guard import Address
from workers.usb import BUS, places_of

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
    own += [config.folder / f"{line_queue(line)}.lock", config.bell_of(line)]
    store = DriverStore(config.drivers_folder)
    segments = segments_of([device.transport for device in devices])
    addresses = [one for device in devices for one in addresses_of(device.transport)]
    if config.valkey.url is not None:
        place = urlsplit(config.valkey.url)
        addresses.append((place.hostname or "127.0.0.1", place.port or 6379))
    return Bounds(
        readable=existing(
            [
                *(store.path(device.digest) for device in devices),
                *_read(devices),
                *_usb_buses([device.transport for device in devices]),
            ]
        ),
        writable=existing([*own, *device_files(devices)]),
        folders=existing([config.files_of(line)]),
        bells=existing([config.bells_path]),
        addresses=tuple(sorted(set(addresses))),
        datagrams=_beats([device.transport for device in devices]),
        segments=segments,
        # The library behind USB asks the kernel what is plugged in, over the same sort of socket.
        has_interfaces=bool(segments) or bool(_on_usb([device.transport for device in devices])),
    )


def bounds_of_address(url: str) -> Bounds:
    """Return what a driver needs that is tried on one address, and nothing of the host's own."""
    return Bounds(
        readable=existing(_public_files([url])),
        writable=existing(_files([url])),
        addresses=tuple(sorted(set(addresses_of(url)))),
        has_local=False,
        has_processes=False,
        datagrams=_beats([url]),
    )


def _beats(urls: Sequence[str]) -> tuple[Address, ...]:
    """Return where datagrams go that keep the watchdogs of devices quiet."""
    found = (beat_of(url) for url in urls)
    return tuple(sorted({one for one in found if one is not None}))


def segments_of(urls: Sequence[str]) -> tuple[Segment, ...]:
    """Return where the datagrams of devices on ROS 2 go."""
    links = [ros2_of(url)[0] for url in urls if url.startswith("ros2:")]
    return tuple(Segment(one.address, one.group, frozenset(one.peers)) for one in links)


def _read(devices: Sequence[DeviceConfig]) -> list[Path]:
    """Return certificates and tokens of devices; a file with anything else is not for them."""
    return _public_files([device.transport for device in devices])


def _public_files(urls: Sequence[str]) -> list[Path]:
    files = [file_of(url) for url in urls]
    return [Path(file) for file in files if file is not None and _is_public(Path(file))]


def _is_public(path: Path) -> bool:
    """Tell whether a file holds certificates and no key, or one token that is for a device."""
    try:
        content = path.read_bytes()
        if path.suffix == ".token":
            if not TOKEN.fullmatch(content.decode("ascii").strip()):
                raise ValueError("no JSON web token")
            return True
        x509.load_pem_x509_certificates(content)
    except (OSError, ValueError) as error:
        log.warning("%s is not what its name says, so that no driver may read it: %s", path, error)
        return False
    if b"PRIVATE KEY" in content:
        log.warning("%s holds a private key, so that no driver may read it", path)
        return False
    return True


def device_files(devices: Sequence[DeviceConfig]) -> list[Path]:
    """Return the serial ports, GPIB boards and USB device files of devices."""
    return _files([device.transport for device in devices])


def _files(urls: Sequence[str]) -> list[Path]:
    lines = [line_key(url).partition(":") for url in urls]
    folder = {"serial": "", "gpib": "/dev/gpib"}
    found = [Path(f"{folder[sort]}{place}") for sort, _, place in lines if sort in folder]
    return [*found, *(one.node for place in _on_usb(urls) for one in places_of(place))]


def _usb_buses(urls: Sequence[str]) -> list[Path]:
    """Return what the kernel tells of the buses of USB instruments, and the list of them."""
    places = _on_usb(urls)
    return [BUS] * bool(places) + [one.bus for place in places for one in places_of(place)]


def _on_usb(urls: Sequence[str]) -> list[str]:
    lines = [line_key(url).partition(":") for url in urls]
    return [place for sort, _, place in lines if sort == "usb"]


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
