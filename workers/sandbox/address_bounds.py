"""What a driver may reach, from the addresses of its devices: files, ports and networks."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509

from drivers.transports.http import TOKEN
from drivers.transports.urls import addresses_of, beat_of, file_of, line_key, ros2_of
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from workers.sandbox.confinement import Bounds, existing
from workers.sandbox.connection_proxy import Address
from workers.sandbox.datagram_proxy import DatagramSegment
from workers.sandbox.usb_device_files import BUS, places_of

log = logging.getLogger(__name__)


def bounds_of_address(url: str) -> Bounds:
    """Return what a driver needs that is tried on one address, and nothing of the host's own."""
    return Bounds(
        readable=existing(public_files([url])),
        writable=existing(_files([url])),
        addresses=tuple(sorted(set(addresses_of(url)))),
        has_local=False,
        has_processes=False,
        datagrams=beats_of([url]),
    )


def beats_of(urls: Sequence[str]) -> tuple[Address, ...]:
    """Return where datagrams go that keep the watchdogs of devices quiet."""
    found = (beat_of(url) for url in urls)
    return tuple(sorted({one for one in found if one is not None}))


def segments_of(urls: Sequence[str]) -> tuple[DatagramSegment, ...]:
    """Return where the datagrams of devices on ROS 2 go."""
    links = [ros2_of(url)[0] for url in urls if url.startswith("ros2:")]
    return tuple(DatagramSegment(one.address, one.group, frozenset(one.peers)) for one in links)


def public_files(urls: Sequence[str]) -> list[Path]:
    """Return certificates and tokens of devices; a file with anything else is not for them."""
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
    return [*found, *(one.node for place in usb_places_of(urls) for one in places_of(place))]


def usb_buses(urls: Sequence[str]) -> list[Path]:
    """Return what the kernel tells of the buses of USB instruments, and the list of them."""
    places = usb_places_of(urls)
    return [BUS] * bool(places) + [one.bus for place in places for one in places_of(place)]


def usb_places_of(urls: Sequence[str]) -> list[str]:
    """Return the places of the devices that hang on USB."""
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
