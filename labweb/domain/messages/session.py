"""Frames of the uplink that open and keep a session: who a host is, and that it lives."""

from __future__ import annotations

from uuid import UUID

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.messages.commands import (
    Tick,
)
from labweb.domain.messages.devices_and_drivers import (
    DeviceConfig,
)
from labweb.domain.messages.protocol_version import (
    PROTOCOL_VERSION,
)


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


class ResumeSession(msgspec.Struct, frozen=True, tag="resume", tag_field="t", kw_only=True):
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


def hello_bytes(hello: Hello, nonce: str) -> bytes:
    """Return what a host signs to prove its key: the nonce and every other field.

    The usual pace is left out, so that a side that does not know of any reads the same bytes.
    """
    plain = msgspec.to_builtins(msgspec.structs.replace(hello, signature=""))
    if hello.pace == 1.0:
        del plain["pace"]
    return canonical({"nonce": nonce, "hello": plain})
