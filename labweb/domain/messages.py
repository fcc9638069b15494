"""Every message between server and edge host: typed, versioned, plain data.

Commands travel signed through the broker and mean nothing until the edge has checked
them; facts travel back as events over the uplink. All frames are JSON, tagged by `t`.
"""

from __future__ import annotations

import hashlib
from typing import Any
from uuid import UUID

import msgspec

PROTOCOL_VERSION = 1
MAX_FRAME_BYTES = 256 * 1024
MAX_EVENTS_PER_FRAME = 500


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


class BatchPart(msgspec.Struct, frozen=True, kw_only=True):
    """What makes an action one of a batch: it goes on by itself, with the server away."""

    batch_id: UUID
    after: list[UUID] = msgspec.field(default_factory=list)
    """Actions of the batch that must be complete before."""

    on_disconnect: str = "finish_current_then_hold"
    """`continue`, `finish_current_then_hold` or `stop_safe`."""

    max_offline_s: float = 0.0
    """Nothing begins when the server has been away for longer; for `continue` only."""


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

    v: int = PROTOCOL_VERSION


class Cancel(msgspec.Struct, frozen=True, tag="cancel", tag_field="t", kw_only=True):
    """Do not start the action; leaves a tombstone when the action is not known."""

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

    issued_by: str = ""
    v: int = PROTOCOL_VERSION


class Receive(msgspec.Struct, frozen=True, tag="receive", tag_field="t", kw_only=True):
    """Take a resource over that a person has found here."""

    host_id: UUID
    epoch: int
    transfer_id: UUID
    view: ResourceView
    dseq: int = 0
    issued_by: str = ""
    v: int = PROTOCOL_VERSION


class Signed(msgspec.Struct, frozen=True, kw_only=True):
    """A command as it travels: the exact text that was signed, and the signature."""

    body: str
    key_id: str
    signature: str
    """Ed25519 over the UTF-8 bytes of `body`, base64."""


class Batch(msgspec.Struct, frozen=True, tag="batch", tag_field="t", kw_only=True):
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


Command = Do | Cancel | Resolve | Reset | Batch | Release | Receive


class EdgeEvent(msgspec.Struct, frozen=True, kw_only=True):
    """One fact of an edge host: gap-free by `seq`, chained by `hash`."""

    seq: int
    prev_hash: str
    hash: str
    kind: str
    """accepted, refused, rejected, stopped, started, actuated, complete, aborted, in_doubt,
    resolved, boot, armed, link_lost, stop_latched, stop_reset, released, kept, received."""

    action_id: UUID | None
    at_s: float
    """Wall clock of the host, for display only."""

    body: dict[str, Any]


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


# --- uplink frames -----------------------------------------------------------------


class Challenge(msgspec.Struct, frozen=True, tag="challenge", tag_field="t", kw_only=True):
    """First frame of the server: sign this."""

    nonce: str
    v: int = PROTOCOL_VERSION


class Hello(msgspec.Struct, frozen=True, tag="hello", tag_field="t", kw_only=True):
    """Who the host is and where its journal stands."""

    host_id: UUID
    journal_id: UUID
    boot_id: str
    armed_boot_id: str | None
    epoch_last: int
    seq_head: int
    hash_head: str
    acked_seq: int
    seal_seq: int
    regression: str = ""
    """Why the host itself takes its journal for an older copy; empty: nothing says so."""

    open_actions: list[UUID] = msgspec.field(default_factory=list)
    instance_id: str = ""
    """Names the process that speaks; another one is another process, or another machine."""

    software: str = ""
    v: int = PROTOCOL_VERSION
    signature: str = ""
    """Ed25519 over `hello_bytes(hello, nonce)`, base64."""


class Welcome(msgspec.Struct, frozen=True, tag="welcome", tag_field="t", kw_only=True):
    """The session: a fresh epoch, and how far the server has read."""

    epoch: int
    acked_seq: int
    floor: int
    server_at_s: float
    mode: str
    """`normal` or `quarantine`."""

    devices: list[DeviceConfig] = msgspec.field(default_factory=list)
    command_keys: dict[str, str] = msgspec.field(default_factory=dict)
    """Public keys that sign commands, base64 by key id."""

    v: int = PROTOCOL_VERSION


class Refuse(msgspec.Struct, frozen=True, tag="refuse", tag_field="t", kw_only=True):
    """The server will not open a session, and why."""

    code: str
    message: str


class Events(msgspec.Struct, frozen=True, tag="events", tag_field="t", kw_only=True):
    """Events from `acked_seq + 1` on, without a gap."""

    epoch: int
    events: list[EdgeEvent]


class Ack(msgspec.Struct, frozen=True, tag="ack", tag_field="t", kw_only=True):
    """Everything up to `seq` is committed on the server."""

    seq: int


class Resume(msgspec.Struct, frozen=True, tag="resume", tag_field="t", kw_only=True):
    """The server has caught up: the host may arm itself and start new work."""

    epoch: int


class Heartbeat(msgspec.Struct, frozen=True, tag="heartbeat", tag_field="t", kw_only=True):
    """Sign of life of the executors, not of the socket."""

    epoch: int
    mono_s: float
    seq_head: int
    stop_latched: bool
    disk_free_bytes: int
    lines: dict[str, float] = msgspec.field(default_factory=dict)
    """Age in seconds of each line's loop."""

    wall_s: float | None = None
    """Wall clock of the host, to show how far it is from the server's; decides nothing."""

    open_count: int = 0
    """Actions of the journal that have not ended."""


class Telemetry(msgspec.Struct, frozen=True, tag="telemetry", tag_field="t", kw_only=True):
    """Samples since the last frame. Lossy by contract; a loss is counted."""

    epoch: int
    samples: list[tuple[str, str, float, Any]]
    """(device id, status, wall seconds, value)."""

    lost_count: int = 0


class StopLab(msgspec.Struct, frozen=True, tag="stop_lab", tag_field="t", kw_only=True):
    """Software stop: halt every device now and latch."""

    stop_id: UUID
    issued_by: str


class StopAcknowledged(
    msgspec.Struct, frozen=True, tag="stop_acknowledged", tag_field="t", kw_only=True
):
    """The latch is on disk and every line was told to halt."""

    stop_id: UUID
    lines: list[str]


class Nudge(msgspec.Struct, frozen=True, tag="nudge", tag_field="t", kw_only=True):
    """A command waits: a doorbell beside the broker's, for a broker that is away."""

    signed: Signed


EdgeFrame = Hello | Events | Heartbeat | Telemetry | StopAcknowledged
ServerFrame = Challenge | Welcome | Refuse | Ack | Resume | StopLab | Nudge


def canonical(value: Any) -> bytes:  # noqa: ANN401 - any plain data
    """Render plain data as JSON with sorted keys and no spaces; what hashes are over."""
    return msgspec.json.encode(value, order="sorted")


def decode_command(body: str | bytes) -> Command:
    """Read a command's signed text.

    Raises:
        msgspec.ValidationError: It is none of the commands; nothing happened.
    """
    command: Command = msgspec.json.decode(body, type=Command)
    return command


def hello_bytes(hello: Hello, nonce: str) -> bytes:
    """Return what a host signs to prove its key: the nonce and every other field."""
    plain = msgspec.to_builtins(msgspec.structs.replace(hello, signature=""))
    return canonical({"nonce": nonce, "hello": plain})


def event_hash(journal_id: UUID, prev_hash: str, event: EdgeEvent) -> str:
    """Return the SHA-256 that binds an event to its journal and all before it."""
    fields = {
        "journal_id": str(journal_id),
        "prev": prev_hash,
        "seq": event.seq,
        "kind": event.kind,
        "action_id": None if event.action_id is None else str(event.action_id),
        "at_s": event.at_s,
        "body": event.body,
    }
    return hashlib.sha256(canonical(fields)).hexdigest()
