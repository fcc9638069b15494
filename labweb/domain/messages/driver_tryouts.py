"""Frames of the uplink by which an author tries a driver on a simulated instrument of a host.

A tryout is no device: nothing of it is in the resource tree, in a journal or in a transaction. The
order is signed by the server's command key for one host and one session, and is no approval: a
line refuses the same source.
"""

from __future__ import annotations

from typing import Any, Literal
from uuid import UUID

import msgspec

from labweb.domain.messages.devices_and_drivers import Signed

MOST_WIRE_RECORDS = 400
"""Records of the tap in one frame, and kept of one tryout; older ones are left out."""

MOST_WIRE_BYTES = 256
"""Bytes of one record; the rest is left out."""

AskSort = Literal["act", "read", "stop", "fault", "cure", "end"]


class SimulatedModel(msgspec.Struct, frozen=True, kw_only=True):
    """A model of simulated instruments that a host can start."""

    model: str
    title: str
    folder: str
    """One of the classes of drivers, `sensors`."""

    speaks: str
    """Sort of carrier, as `DriverSpec.transport` has it."""

    carriers: list[str]
    settings: dict[str, Any]
    """JSON Schema."""

    faults: dict[str, dict[str, Any]]
    """JSON Schema of the options, by name."""


class TryoutOffer(msgspec.Struct, frozen=True, tag="tryout_offer", tag_field="t", kw_only=True):
    """What a host can simulate; told once in each session of a host that offers it."""

    epoch: int
    models: list[SimulatedModel]
    problem: str = ""
    """Why the host tries no drivers although it was told to; then there are no models."""


class TryoutOrder(msgspec.Struct, frozen=True, tag="tryout_order", tag_field="t", kw_only=True):
    """What the server's key signs before a host runs source that nobody approved."""

    tryout_id: UUID
    host_id: UUID
    epoch: int
    """Session for which it is good."""

    digest: str
    class_name: str
    config: dict[str, Any]
    """Settings of the driver."""

    model: str
    settings: dict[str, Any]
    """Settings of the simulated instrument."""

    speed: float
    """Simulated seconds per second."""

    asked_by: str


class TryoutPart(msgspec.Struct, frozen=True, tag="tryout_part", tag_field="t", kw_only=True):
    """One piece of a bundle, in order; `count` pieces make it whole, and begin the tryout."""

    tryout_id: UUID
    index: int
    count: int
    data: bytes
    order: Signed | None = None
    """A signed `TryoutOrder`; with the first piece."""


class TryoutAsk(msgspec.Struct, frozen=True, tag="tryout_ask", tag_field="t", kw_only=True):
    """What the author wants of a tryout that runs."""

    tryout_id: UUID
    number: int
    """Counts from 1; the same one twice is one wish."""

    sort: AskSort
    name: str = ""
    """Action or fault."""

    args: dict[str, Any] = msgspec.field(default_factory=dict)
    within_s: float = 30.0
    """How long the driver may take; then its process is ended."""


class WireRecord(msgspec.Struct, frozen=True, array_like=True):
    """Bytes that crossed the line."""

    n: int
    at_s: float
    """Seconds since the tryout began."""

    direction: str
    """`in`: towards the instrument."""

    hex: str


class TryoutTold(msgspec.Struct, frozen=True, tag="tryout_told", tag_field="t", kw_only=True):
    """What becomes of a tryout, and of one wish."""

    epoch: int
    tryout_id: UUID
    state: Literal["running", "ended"]
    number: int = 0
    """Wish that is answered; 0: none."""

    code: str = ""
    """Empty: it went well."""

    message: str = ""
    """Why it failed; of a tryout that ended, why."""

    effect: str = ""
    data: dict[str, Any] = msgspec.field(default_factory=dict)
    """Of an action its report; of a reading, values or problems by status."""

    faults: list[str] = msgspec.field(default_factory=list)
    """In force now."""

    wire: list[WireRecord] = msgspec.field(default_factory=list)
    """What crossed the line since the last frame."""

    wire_left_out_count: int = 0
