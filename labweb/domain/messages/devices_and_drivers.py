"""What a host is told of its devices, and how the source of their drivers comes to it."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec


class Signed(msgspec.Struct, frozen=True, kw_only=True):
    """A command as it travels: the exact text that was signed, and the signature."""

    body: str
    key_id: str
    signature: str
    """Ed25519 over the UTF-8 bytes of `body`, base64."""


class DeviceConfig(msgspec.Struct, frozen=True, kw_only=True):
    """What a host needs to serve one of its admitted devices."""

    id: UUID
    key: str
    name: str
    module: str
    class_name: str
    digest: str
    transport: str
    config: dict[str, Any]
    statuses: dict[str, float]
    """Sampling period in seconds by status."""

    nodes: dict[str, UUID]
    admission: dict[str, dict[str, float]] | None = None
    """Admitted actions with their limits; None: all that the driver declares."""

    public_key: str = ""
    """Key with which it announced itself when it was admitted; "": it has none."""


class DriverApproval(
    msgspec.Struct, frozen=True, tag="driver_approval", tag_field="t", kw_only=True
):
    """What the server's key signs when a driver's source is approved."""

    digest: str
    """SHA-256 of the bundle."""

    module: str
    class_name: str
    origin: str
    """`release`: it came with labweb. `upload`: a person brought it, and another approved it."""

    proposed_by: str = ""
    approved_by: str = ""
    """Ids of the two people; for an upload both are named and differ."""

    approved_at: str = ""


class DevicesFrame(msgspec.Struct, frozen=True, tag="devices", tag_field="t", kw_only=True):
    """What the host serves from now on, and what it makes ready, within the same session."""

    epoch: int
    devices: list[DeviceConfig]
    staged: list[DeviceConfig] = msgspec.field(default_factory=list)


class WantDriver(msgspec.Struct, frozen=True, tag="want_driver", tag_field="t", kw_only=True):
    """The host has not the source of a driver that it is to serve or to make ready."""

    digest: str


class DriverPart(msgspec.Struct, frozen=True, tag="driver_part", tag_field="t", kw_only=True):
    """One piece of a bundle, in order; `count` pieces make it whole."""

    digest: str
    index: int = 0
    count: int = 0
    data: bytes = b""
    """Base64 in JSON."""

    approval: Signed | None = None
    """A signed `DriverApproval`; with the first piece."""

    problem: str = ""
    """Why the source is not given; then there is no data."""
