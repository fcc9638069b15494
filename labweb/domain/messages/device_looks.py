"""Frames of the uplink by which a host looks at a device that no line serves yet.

A look reads and moves nothing: the host asks who answers and has every status told, in a confined
process, with a version of the driver that was approved. Nothing of it is in a journal.
"""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.messages.devices_and_drivers import Signed


class LookOrder(msgspec.Struct, frozen=True, tag="look_order", tag_field="t", kw_only=True):
    """What the server's key signs before a host opens the address of a device."""

    look_id: UUID
    host_id: UUID
    epoch: int
    """Session for which it is good."""

    digest: str
    class_name: str
    transport: str
    config: dict[str, Any]
    """Settings of the driver."""

    asked_by: str


class LookPart(msgspec.Struct, frozen=True, tag="look_part", tag_field="t", kw_only=True):
    """One piece of a driver's bundle, in order; `count` pieces make it whole."""

    look_id: UUID
    index: int
    count: int
    data: bytes
    order: Signed | None = None
    """A signed `LookOrder`; with the first piece."""

    approval: Signed | None = None
    """A signed `DriverApproval`; with the first piece."""


class LookTold(msgspec.Struct, frozen=True, tag="look_told", tag_field="t", kw_only=True):
    """What a host has seen of a device, or why it could not look."""

    epoch: int
    look_id: UUID
    code: str = ""
    """Empty: the expected model answered."""

    message: str = ""
    took_s: float = 0.0
    """From opening the line to the last status."""

    values: dict[str, Any] = msgspec.field(default_factory=dict)
    problems: dict[str, str] = msgspec.field(default_factory=dict)
    """Why a status was not told, by name."""
