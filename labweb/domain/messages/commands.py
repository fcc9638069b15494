"""Commands of the server to a host: signed, and nothing until the host has checked them."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.calibration.correction import Correction
from labweb.domain.messages.devices_and_drivers import (
    Signed,
)
from labweb.domain.messages.protocol_version import (
    PROTOCOL_VERSION,
)


class StandingView(msgspec.Struct, frozen=True, kw_only=True):
    """What stands in a place, as far as it takes room there."""

    id: UUID
    name: str
    kind: str


class ResourceView(msgspec.Struct, frozen=True, kw_only=True):
    """State of one resource as the server knows it when it dispatches."""

    id: UUID
    name: str
    kind: str
    rev: int
    """Raised by one at every settled change of the resource."""

    parent_id: UUID | None = None
    contents: dict[str, int] = msgspec.field(default_factory=dict)
    """Nanolitres by lot."""

    capacity_nl: int | None = None
    dead_volume_nl: int = 0
    data: dict[str, Any] = msgspec.field(default_factory=dict)
    is_archived: bool = False
    there: list[StandingView] = msgspec.field(default_factory=list)
    """Of a place to which something is carried: what stands there before."""

    sites_count: int | None = None
    """How many things a rack or a carrier takes; None: nobody stated it."""


class BatchPart(msgspec.Struct, frozen=True, kw_only=True):
    """What makes an action one of a batch: it goes on by itself, with the server away."""

    batch_id: UUID
    after: list[UUID] = msgspec.field(default_factory=list)
    """Actions of the batch that must be complete before."""

    on_disconnect: str = "finish_current_then_hold"
    """`continue`, `finish_current_then_hold` or `stop_safe`."""

    max_offline_s: float = 0.0
    """Nothing begins when the server has been away for longer; for `continue` only."""

    meets: UUID | None = None
    """Another member, on another device: both begin at the same moment or none does. Of a pair,
    the first member gives and the second receives (`runs.meeting`)."""


class Tick(msgspec.Struct, frozen=True, kw_only=True):
    """A moment of the server by a clock that nobody sets."""

    clock: str
    """Which clock: this start of this machine. Ticks of two clocks cannot be compared."""

    at_s: float
    """Since that start, the time in which the machine slept among it."""


class Do(msgspec.Struct, frozen=True, tag="do", tag_field="t", kw_only=True):
    """Carry out one action once."""

    host_id: UUID
    epoch: int
    dseq: int
    """Dispatch sequence of the host; also the fence of the device."""

    action_id: UUID
    job_id: UUID
    run_id: UUID
    attempt: int
    line: str
    device_id: UUID
    driver_digest: str
    action: str
    args: dict[str, Any]
    operation: dict[str, Any]
    pre: list[dict[str, Any]] = msgspec.field(default_factory=list)
    post: list[dict[str, Any]] = msgspec.field(default_factory=list)
    resources: list[ResourceView] = msgspec.field(default_factory=list)
    ttl_s: float = 3600.0
    """Not started within this time of its acceptance means rejected."""

    timeout_s: float = 60.0
    issued_by: str = ""
    approvals: list[str] = msgspec.field(default_factory=list)
    batch: BatchPart | None = None
    """None: it stands alone."""

    corrections: list[Correction] = msgspec.field(default_factory=list)
    """Arguments that a calibration has changed. `args` are as sent: a host corrects nothing; it
    only reads by this what the device says it moved."""

    numbers_hold_s: float | None = None
    """Not started within this time of its acceptance, or of `sent`, means given back: the
    calibration that made its numbers has ended by then. None: no calibration made them."""

    sent: Tick | None = None
    """When it was signed: it may lie in the broker for long before a host accepts it."""

    v: int = PROTOCOL_VERSION


class Cancel(msgspec.Struct, frozen=True, tag="cancel", tag_field="t", kw_only=True):
    """Do not start the action, or halt it; leaves a tombstone when the action is not known."""

    host_id: UUID
    epoch: int
    dseq: int
    action_id: UUID
    issued_by: str = ""
    is_recall: bool = False
    """The server wants an action back that has not started, to send it again later."""

    v: int = PROTOCOL_VERSION


class Resolve(msgspec.Struct, frozen=True, tag="resolve", tag_field="t", kw_only=True):
    """What a person found out about an action in doubt."""

    host_id: UUID
    epoch: int
    dseq: int
    action_id: UUID
    answer: str
    """`happened`, `did_not`, `partly` or `discard`."""

    moved_nl: int | None = None
    note: str = ""
    issued_by: str = ""
    despite_reading: str = ""
    """What the device reads otherwise, where the person answers despite that."""

    v: int = PROTOCOL_VERSION


class Reset(msgspec.Struct, frozen=True, tag="reset", tag_field="t", kw_only=True):
    """Release one stop of the host; a person gave the reason. Starts nothing."""

    host_id: UUID
    epoch: int
    dseq: int
    stop_id: UUID
    """The stop that is released; a latch of any other stop stays closed."""

    reason: str
    issued_by: str = ""
    v: int = PROTOCOL_VERSION


class Halt(msgspec.Struct, frozen=True, tag="halt", tag_field="t", kw_only=True):
    """Halt one device, whether something acts on it or not; done once, however often sent."""

    host_id: UUID
    epoch: int
    dseq: int
    halt_id: UUID
    """Names the wish for ever."""

    device_id: UUID
    code: str
    """Why: `edge.run_aborted` or `edge.device_stopped`."""

    issued_by: str = ""
    v: int = PROTOCOL_VERSION


class Release(msgspec.Struct, frozen=True, tag="release", tag_field="t", kw_only=True):
    """Let a resource go, for another host to take over."""

    host_id: UUID
    epoch: int
    transfer_id: UUID
    """Names the move for ever."""

    resource_id: UUID
    dseq: int = 0
    view: ResourceView | None = None
    """What the server knows of it, for a host that never had it in its hands."""

    parts: list[ResourceView] = msgspec.field(default_factory=list)
    """All that stands in it, as the server knows it: it goes along."""

    issued_by: str = ""
    v: int = PROTOCOL_VERSION


class ReceiveCommand(msgspec.Struct, frozen=True, tag="receive", tag_field="t", kw_only=True):
    """Take a resource over, with all that stands in it, that is here or fetched from there."""

    host_id: UUID
    epoch: int
    transfer_id: UUID
    view: ResourceView
    parts: list[ResourceView] = msgspec.field(default_factory=list)
    dseq: int = 0
    issued_by: str = ""
    v: int = PROTOCOL_VERSION


class HostBatch(msgspec.Struct, frozen=True, tag="batch", tag_field="t", kw_only=True):
    """All that one host does of a run from here on: taken whole, or not at all."""

    host_id: UUID
    epoch: int
    dseq: int
    """Of its first member."""

    batch_id: UUID
    members: list[Signed]
    """A signed `Do` each, in the order of their dispatch; none carries resources."""

    resources: list[ResourceView] = msgspec.field(default_factory=list)
    """All that the members use, as it stands before the first."""

    issued_by: str = ""
    v: int = PROTOCOL_VERSION


Command = Do | Cancel | Resolve | Reset | Halt | HostBatch | Release | ReceiveCommand


class Nudge(msgspec.Struct, frozen=True, tag="nudge", tag_field="t", kw_only=True):
    """A command waits: a doorbell beside the broker's, for a broker that is away."""

    signed: Signed


def decode_command(body: str | bytes) -> Command:
    """Read a command's signed text.

    Raises:
        msgspec.ValidationError: It is none of the commands; nothing happened.
    """
    command: Command = msgspec.json.decode(body, type=Command)
    return command
