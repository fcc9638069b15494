"""What the lab feed tells, as typed rows, and how deltas change it."""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec

from labweb.domain.errors import StateError

T = TypeVar("T")


class PoseRow(msgspec.Struct, frozen=True):
    """Pose in the parent's frame."""

    x_mm: float
    y_mm: float
    z_mm: float
    rotation_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


class TwinResource(msgspec.Struct, frozen=True, kw_only=True):
    """One node of the tree with what it holds."""

    id: str
    key: str
    parent_id: str | None
    name: str
    kind: str
    pose: PoseRow | None = None
    """None is unknown."""

    size_mm: tuple[float, float, float] | None = None
    capacity_ul: float | None = None
    ports_count: int | None = None
    common_port: str = "common"
    shape: str = ""
    """`round` for a flask with a round bottom."""

    contents_nl: dict[str, int] = {}
    """Nanolitres by the lot's number in the lab."""

    is_quarantined: bool = False
    is_archived: bool = False

    @property
    def total_ul(self) -> float:
        """Volume of everything in it."""
        return sum(self.contents_nl.values()) / 1000.0


class TwinTubeEnd(msgspec.Struct, frozen=True):
    """One end of a connection."""

    resource_id: str
    port: str


class TwinConnection(msgspec.Struct, frozen=True, kw_only=True):
    """A tube, or a probe that stands in a vessel."""

    id: str
    key: str
    medium: str = "liquid"
    source: TwinTubeEnd
    target: TwinTubeEnd


class TwinDevice(msgspec.Struct, frozen=True, kw_only=True):
    """One instrument."""

    id: str
    name: str
    nodes: dict[str, str]
    """Role in the driver → resource id."""

    state: str
    link: str


class TwinJob(msgspec.Struct, frozen=True, kw_only=True):
    """What a device does at this moment, or did when its outcome was lost."""

    id: str
    device_id: str
    state: str
    sentence: str
    source_id: str = ""
    """Vessel a transfer draws from; empty when the job moves no liquid."""

    target_id: str = ""
    amount_nl: int = 0


class TwinLab(msgspec.Struct, frozen=True, kw_only=True):
    """The lab itself."""

    key: str
    name: str
    mode: str
    is_stopped: bool = False


class Message(msgspec.Struct, frozen=True):
    """One message of the feed."""

    seq: int
    kind: str
    data: Any


class Snapshot(msgspec.Struct, kw_only=True):
    """The whole lab at one moment, kept up to date by deltas."""

    lab: TwinLab
    resources: dict[str, TwinResource]
    connections: dict[str, TwinConnection]
    devices: dict[str, TwinDevice]
    jobs: dict[str, TwinJob]
    telemetry: dict[str, dict[str, tuple[float, Any]]]
    """Device → status → wall seconds of the host, value."""


class _Changes(msgspec.Struct, frozen=True):
    changed: dict[str, Any] = {}
    gone: tuple[str, ...] = ()


ROWS: dict[str, type[Any]] = {
    "resources": TwinResource,
    "connections": TwinConnection,
    "devices": TwinDevice,
    "jobs": TwinJob,
}


class GapError(StateError):
    """A message is missing: nothing was changed; ask for a snapshot."""


class TwinLabView:
    """What the twin knows of the lab."""

    def __init__(self) -> None:
        self.snapshot: Snapshot | None = None
        self.seq = 0
        self.version = 0
        """Raised by every message that changed something."""

    def take(self, message: Message) -> None:
        """Apply one message.

        Raises:
            GapError: It is not the next one.
            msgspec.ValidationError: It has not the shape of its kind.
        """
        if message.kind == "snapshot":
            self.snapshot = msgspec.convert(message.data, Snapshot)
            self.seq = message.seq
            self.version += 1
            return
        if self.snapshot is None or message.seq != self.seq + 1:
            raise GapError(f"got message {message.seq} of the feed after {self.seq}")
        self._change(self.snapshot, message)
        self.seq = message.seq

    def _change(self, snapshot: Snapshot, message: Message) -> None:
        if message.kind in ROWS:
            changes = msgspec.convert(message.data, _Changes)
            kind = ROWS[message.kind]
            changed = {key: msgspec.convert(row, kind) for key, row in changes.changed.items()}
            rows = getattr(snapshot, message.kind)
            rows.update(changed)
            for key in changes.gone:
                rows.pop(key, None)
        elif message.kind == "lab":
            snapshot.lab = msgspec.convert(message.data, TwinLab)
        elif message.kind == "telemetry":
            wanted = dict[str, dict[str, tuple[float, Any]]]
            for device_id, statuses in msgspec.convert(message.data, wanted).items():
                snapshot.telemetry.setdefault(device_id, {}).update(statuses)
        elif message.kind != "beat":
            raise msgspec.ValidationError(f"no kind {message.kind!r} in the feed")
        if message.kind != "beat":
            self.version += 1
