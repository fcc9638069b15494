"""Confine the process of a line to what its devices and its own work need."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from urllib.parse import urlsplit

from drivers.transports.urls import addresses_of
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from workers.base import faults
from workers.base.config import HostConfig, line_queue
from workers.line.driver_store import DriverStore
from workers.sandbox.address_bounds import (
    beats_of,
    device_files,
    public_files,
    segments_of,
    usb_buses,
    usb_places_of,
)
from workers.sandbox.confinement import Bounds, confine, describe, existing, is_possible

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
                *public_files([device.transport for device in devices]),
                *usb_buses([device.transport for device in devices]),
            ]
        ),
        writable=existing([*own, *device_files(devices)]),
        folders=existing([config.files_of(line)]),
        bells=existing([config.bells_path]),
        addresses=tuple(sorted(set(addresses))),
        datagrams=beats_of([device.transport for device in devices]),
        segments=segments,
        # The library behind USB asks the kernel what is plugged in, over the same sort of socket.
        has_interfaces=bool(segments)
        or bool(usb_places_of([device.transport for device in devices])),
    )
