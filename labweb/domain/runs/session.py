"""The handshake between a host and the server, as the server decides it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from uuid import UUID

from labweb.domain.messages import EdgeEvent, Hello, event_hash


class SessionState(StrEnum):
    """How the server sees a host."""

    ENROLLING = "enrolling"
    ONLINE = "online"
    SUSPECT = "suspect"
    ISOLATED = "isolated"
    SYNCING = "syncing"
    QUARANTINED = "quarantined"
    FENCED = "fenced"
    REVOKED = "revoked"


SUSPECT_AFTER_S = 10.0
ISOLATED_AFTER_S = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HostRecord:
    """What the server remembers of a host's journal."""

    host_id: UUID
    journal_id: UUID | None
    """None until the first HELLO."""

    acked_seq: int
    hash_at_acked: str
    epoch: int
    is_revoked: bool = False


@dataclass(frozen=True, slots=True)
class HelloAnswer:
    """Verdict on a HELLO whose signature holds."""

    kind: str
    """`normal`, `quarantine` or `refuse`."""

    code: str = ""
    message: str = ""


def decide_hello(record: HostRecord, hello: Hello) -> HelloAnswer:
    """Decide whether a host's journal continues the one the server knows.

    A journal that went back in time means that actions may have happened which it no
    longer knows of: quarantine, and a person takes stock.
    """
    if record.is_revoked:
        return HelloAnswer("refuse", "host.revoked", "this host's key was revoked")
    if record.journal_id is None:
        return HelloAnswer("normal")
    if hello.journal_id != record.journal_id:
        return HelloAnswer("quarantine", "host.other_journal", "the host has another journal")
    if hello.seq_head < record.acked_seq:
        return HelloAnswer(
            "quarantine",
            "host.journal_regressed",
            f"the journal ends at {hello.seq_head}, the server has read up to {record.acked_seq}",
        )
    if hello.seal_seq > hello.seq_head:
        return HelloAnswer(
            "quarantine",
            "host.behind_seal",
            f"the seal says {hello.seal_seq}, the journal ends at {hello.seq_head}",
        )
    if hello.epoch_last > record.epoch:
        return HelloAnswer(
            "quarantine", "host.future_epoch", "the host knows an epoch the server never gave"
        )
    return HelloAnswer("normal")


@dataclass(frozen=True, slots=True)
class Intake:
    """Which events of a frame to apply, or why none."""

    fresh: tuple[EdgeEvent, ...] = ()
    code: str = ""
    message: str = ""


def check_events(record: HostRecord, events: Sequence[EdgeEvent]) -> Intake:
    """Sort out a frame of events: drop repeats, refuse gaps and forks.

    Raises nothing: a refusal is recorded, so it is returned.
    """
    journal_id = record.journal_id
    if journal_id is None:
        return Intake(code="host.no_session", message="events before HELLO")
    fresh: list[EdgeEvent] = []
    seq, head = record.acked_seq, record.hash_at_acked
    for event in events:
        if event.seq <= record.acked_seq:
            continue
        if event.seq != seq + 1:
            return Intake(code="host.gap", message=f"expected event {seq + 1}, got {event.seq}")
        if event.prev_hash != head or event.hash != event_hash(journal_id, head, event):
            return Intake(code="host.fork", message=f"event {event.seq} breaks the hash chain")
        fresh.append(event)
        seq, head = event.seq, event.hash
    return Intake(fresh=tuple(fresh))


def state_by_silence(current: SessionState, silent_s: float) -> SessionState:
    """Return the state after so many seconds without a heartbeat."""
    if current not in {SessionState.ONLINE, SessionState.SUSPECT, SessionState.SYNCING}:
        return current
    if silent_s >= ISOLATED_AFTER_S:
        return SessionState.ISOLATED
    if silent_s >= SUSPECT_AFTER_S and current is SessionState.ONLINE:
        return SessionState.SUSPECT
    return current
