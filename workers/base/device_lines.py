"""Which devices share a line."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from drivers.transports.urls import line_key
from labweb.domain.canonical_json import canonical
from labweb.domain.errors import DefinitionError
from labweb.domain.messages.devices_and_drivers import DeviceConfig


def lines_of(devices: Sequence[DeviceConfig]) -> dict[str, list[DeviceConfig]]:
    """Group devices by the wire they share; one whose address is unreadable has no line."""
    lines: dict[str, list[DeviceConfig]] = {}
    for device in sorted(devices, key=lambda one: one.id):
        try:
            key = line_key(device.transport)
        except DefinitionError:
            continue
        lines.setdefault(key, []).append(device)
    return lines


def fingerprint(devices: Sequence[DeviceConfig]) -> str:
    """Return a text that changes when any device's configuration does."""
    return hashlib.sha256(canonical(list(devices))).hexdigest()
