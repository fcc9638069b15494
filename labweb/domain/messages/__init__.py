"""Every message between server and edge host: typed, versioned, plain data.

Commands travel signed through the broker and mean nothing until the edge has checked
them; facts travel back as events over the uplink. All frames are JSON, tagged by `t`.
"""

from __future__ import annotations

import hashlib
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.action_files import FileAsked, FileGone, FileOffer, FilePart, FileTaken
from labweb.domain.canonical_json import canonical as canonical
from labweb.domain.messages.action_asks import Ask as Ask
from labweb.domain.messages.action_asks import AskTold as AskTold
from labweb.domain.messages.action_asks import WithdrawAsk as WithdrawAsk
from labweb.domain.messages.certificates_and_sightings import Renew as Renew
from labweb.domain.messages.certificates_and_sightings import Renewed as Renewed
from labweb.domain.messages.certificates_and_sightings import Sighting as Sighting
from labweb.domain.messages.certificates_and_sightings import Sightings as Sightings
from labweb.domain.messages.chain_heads import ChainHead as ChainHead
from labweb.domain.messages.chain_heads import Countersigned as Countersigned
from labweb.domain.messages.chain_heads import Heads as Heads
from labweb.domain.messages.chain_heads import countersigned_bytes as countersigned_bytes
from labweb.domain.messages.chain_heads import read_head as read_head
from labweb.domain.messages.commands import Batch as Batch
from labweb.domain.messages.commands import BatchPart as BatchPart
from labweb.domain.messages.commands import Cancel as Cancel
from labweb.domain.messages.commands import Command as Command
from labweb.domain.messages.commands import Do as Do
from labweb.domain.messages.commands import Halt as Halt
from labweb.domain.messages.commands import Receive as Receive
from labweb.domain.messages.commands import Release as Release
from labweb.domain.messages.commands import Reset as Reset
from labweb.domain.messages.commands import Resolve as Resolve
from labweb.domain.messages.commands import ResourceView as ResourceView
from labweb.domain.messages.commands import StandingView as StandingView
from labweb.domain.messages.commands import Tick as Tick
from labweb.domain.messages.device_looks import LookOrder as LookOrder
from labweb.domain.messages.device_looks import LookPart as LookPart
from labweb.domain.messages.device_looks import LookTold as LookTold
from labweb.domain.messages.devices_and_drivers import DeviceConfig as DeviceConfig
from labweb.domain.messages.devices_and_drivers import Devices as Devices
from labweb.domain.messages.devices_and_drivers import DriverApproval as DriverApproval
from labweb.domain.messages.devices_and_drivers import DriverPart as DriverPart
from labweb.domain.messages.devices_and_drivers import Signed as Signed
from labweb.domain.messages.devices_and_drivers import WantDriver as WantDriver
from labweb.domain.messages.driver_tryouts import SimulatedModel as SimulatedModel
from labweb.domain.messages.driver_tryouts import TryoutAsk as TryoutAsk
from labweb.domain.messages.driver_tryouts import TryoutOffer as TryoutOffer
from labweb.domain.messages.driver_tryouts import TryoutOrder as TryoutOrder
from labweb.domain.messages.driver_tryouts import TryoutPart as TryoutPart
from labweb.domain.messages.driver_tryouts import TryoutTold as TryoutTold
from labweb.domain.messages.driver_tryouts import WireRecord as WireRecord
from labweb.domain.messages.protocol_version import NOT_KNOWN as NOT_KNOWN
from labweb.domain.messages.protocol_version import PROTOCOL_VERSION as PROTOCOL_VERSION
from labweb.domain.messages.protocol_version import unknown_frame as unknown_frame
from labweb.domain.messages.protocol_version import version_refusal as version_refusal
from labweb.domain.messages.telemetry import Telemetry as Telemetry
from labweb.domain.messages.telemetry import TelemetryGap as TelemetryGap
from labweb.domain.messages.telemetry import TelemetryTaken as TelemetryTaken

CLOSE_BAD_FRAME = 4400
"""Code with which the server closes a connection on which it was sent what it does not know."""

MAX_FRAME_BYTES = 256 * 1024
MAX_EVENTS_PER_FRAME = 500


class EdgeEvent(msgspec.Struct, frozen=True, kw_only=True):
    """One fact of an edge host: gap-free by `seq`, chained by `hash`."""

    seq: int
    prev_hash: str
    hash: str
    kind: str
    """accepted, refused, rejected, stopped, started, actuated, complete, aborted, in_doubt,
    resolved, boot, armed, link_lost, stop_latched, stop_reset, released, kept, received,
    driver_ready, driver_refused, driver_serving, countersigned, head_refused."""

    action_id: UUID | None
    at_s: float
    """Clock of the host that people and programs set: what it showed."""

    body: dict[str, Any]
    mono_s: float | None = None
    """Clock of the host that only runs; None: an older program wrote the event."""

    boot_id: str = ""
    """Start of the machine from which that clock runs."""

    happened_s: float | None = None
    """The moment by the server's clock, as the host knows when it tells; no part of the hash."""

    uncertainty_s: float | None = None
    """At most so far is `happened_s` wrong; None: the host has not measured."""


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
    pace: float = 1.0
    """Seconds of lab time in one real second; another than 1 at simulated instruments alone."""

    v: int = PROTOCOL_VERSION
    signature: str = ""
    """Ed25519 over `hello_bytes(hello, nonce)`, base64."""


class Welcome(msgspec.Struct, frozen=True, tag="welcome", tag_field="t", kw_only=True):
    """The session: a fresh epoch, and how far the server has read."""

    epoch: int
    acked_seq: int
    floor: int
    server_at_s: float
    heard_at_s: float | None = None
    """When the HELLO came, by the clock of `server_at_s`, which is read last."""

    tick: Tick | None = None
    """The same moment by a clock that nobody sets; None: the server has none."""

    mode: str
    """`normal` or `quarantine`."""

    devices: list[DeviceConfig] = msgspec.field(default_factory=list)
    staged: list[DeviceConfig] = msgspec.field(default_factory=list)
    """Devices that shall have another version of their driver: fetch it, try it, and tell."""

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
    """Of the disk on which the journal lies."""

    disk_total_bytes: int = 0
    """0: the host does not say."""

    is_disk_read_only: bool = False
    lines: dict[str, float] = msgspec.field(default_factory=dict)
    """Age in seconds of each line's loop."""

    wall_s: float | None = None
    """Wall clock of the host, to show how far it is from the server's; decides nothing."""

    asked_s: float | None = None
    """What the server is to say back in its `Pulse`: the clock of events, when this was sent."""

    open_count: int = 0
    """Actions of the journal that have not ended."""

    confinement: str = ""
    """How the processes of the lines are confined, in words; empty: the host does not say."""

    serving: dict[str, str] | None = None
    """Digest of the version that serves, by device; None: as was said last in this session."""

    halts_owed: frozenset[UUID] = frozenset()
    """Devices that have to be halted before they act again, and were not yet."""


class Pulse(msgspec.Struct, frozen=True, tag="pulse", tag_field="t", kw_only=True):
    """Answer to a sign of life: how late it is here."""

    asked_s: float
    """As it came."""

    heard_at_s: float
    """When the sign of life came."""

    told_at_s: float
    """When this was sent."""


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


EdgeFrame = (
    Hello
    | Events
    | Heartbeat
    | Telemetry
    | StopAcknowledged
    | FileOffer
    | FilePart
    | FileGone
    | Renew
    | Sightings
    | WantDriver
    | Ask
    | WithdrawAsk
    | TryoutOffer
    | TryoutTold
    | LookTold
)
ServerFrame = (
    Challenge
    | Welcome
    | Refuse
    | Ack
    | Resume
    | StopLab
    | Nudge
    | FileTaken
    | FileAsked
    | Renewed
    | Devices
    | DriverPart
    | AskTold
    | TelemetryTaken
    | TryoutPart
    | TryoutAsk
    | LookPart
    | Heads
    | Pulse
)


def decode_command(body: str | bytes) -> Command:
    """Read a command's signed text.

    Raises:
        msgspec.ValidationError: It is none of the commands; nothing happened.
    """
    command: Command = msgspec.json.decode(body, type=Command)
    return command


def hello_bytes(hello: Hello, nonce: str) -> bytes:
    """Return what a host signs to prove its key: the nonce and every other field.

    The usual pace is left out, so that a side that does not know of any reads the same bytes.
    """
    plain = msgspec.to_builtins(msgspec.structs.replace(hello, signature=""))
    if hello.pace == 1.0:
        del plain["pace"]
    return canonical({"nonce": nonce, "hello": plain})


def event_hash(
    journal_id: UUID, prev_hash: str, event: EdgeEvent, body: bytes | None = None
) -> str:
    """Return the SHA-256 that binds an event to its journal and all before it.

    `body` is the event's body as canonical text; None renders it. An event of a program that
    read one clock alone is bound as that program bound it.
    """
    fields = {
        "journal_id": str(journal_id),
        "prev": prev_hash,
        "seq": event.seq,
        "kind": event.kind,
        "action_id": None if event.action_id is None else str(event.action_id),
        "at_s": event.at_s,
        "body": event.body if body is None else msgspec.Raw(body),
    }
    if event.boot_id:
        fields["clock"] = {"boot_id": event.boot_id, "mono_s": event.mono_s}
    return hashlib.sha256(canonical(fields)).hexdigest()
