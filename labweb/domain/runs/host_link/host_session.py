"""The handshake between a host and the server, as the server decides it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from uuid import UUID

from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.domain.messages.session import Hello


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


FENCED_CODE = "host.fenced"
MOST_BOOTS = 16
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
    last_dseq: int = 0
    """Highest dispatch ever given to the host."""

    floor: int = 0
    """Dispatches below it were given up; the host may start none of them."""

    epoch_seen: int = 0
    """Highest epoch under which the host has sent anything: it is on the host's disk."""

    boots: tuple[str, ...] = ()
    """Starts of the machine that have had a session, the latest last."""

    is_revoked: bool = False
    quarantine: str = ""
    """Code of the quarantine the host is in; only a person's readmission ends it."""


@dataclass(frozen=True, slots=True)
class HelloAnswer:
    """Verdict on a HELLO whose signature holds."""

    kind: str
    """`normal`, `quarantine` or `refuse`."""

    code: str = ""
    message: str = ""


def pace_refusal(pace: float, *, is_simulated: bool) -> str:
    """Say why a host may not run at its pace; empty: it may. Real instruments have none but 1.

    Example:
        >>> pace_refusal(20.0, is_simulated=True)
        ''
    """
    if pace == 1.0 or (is_simulated and 0 < pace < float("inf")):
        return ""
    return (
        f"the host runs {pace:g} times as fast as real time, and the lab is live: "
        "set its pace to 1 in host.json"
    )


def decide_hello(record: HostRecord, hello: Hello, *, live_instance_id: str = "") -> HelloAnswer:
    """Decide whether a host's journal continues the one the server knows.

    A journal that went back in time means that actions may have happened which it no
    longer knows of: quarantine, and a person takes stock. Two machines with one identity
    are found by the session that only one of them knows, or by a start of the machine that
    comes back after another.

    Args:
        record: What is known of the host.
        hello: What it says, with a signature that holds.
        live_instance_id: Process whose connection is open and not silent; empty: there is
            none. While it lives, another process is refused, so that two copies of one
            journal never act at the same time.
    """
    if record.is_revoked:
        return HelloAnswer("refuse", "host.revoked", "this host's key was revoked")
    if live_instance_id and hello.instance_id != live_instance_id:
        text = "another process speaks with this host's identity at this moment"
        return HelloAnswer("refuse", "host.rival", text)
    if record.quarantine:
        return HelloAnswer("quarantine", record.quarantine, "a person has to readmit this host")
    if hello.regression:
        return HelloAnswer("quarantine", "host.behind_seal", hello.regression)
    if record.journal_id is None:
        return HelloAnswer("normal")
    if hello.journal_id != record.journal_id:
        return HelloAnswer("quarantine", "host.other_journal", "the host has another journal")
    if hello.boot_id in record.boots[:-1]:
        text = "two machines use this host's identity in turn: one of them is a copy"
        return HelloAnswer("quarantine", "host.clone", text)
    return _decide_history(record, hello)


def _decide_history(record: HostRecord, hello: Hello) -> HelloAnswer:
    if hello.seq_head < record.acked_seq:
        return HelloAnswer(
            "quarantine",
            "host.journal_regressed",
            f"the journal ends at {hello.seq_head}, the server has read up to {record.acked_seq}",
        )
    if hello.seq_head == record.acked_seq and hello.hash_head != record.hash_at_acked:
        return HelloAnswer(
            "quarantine", "host.fork", f"event {hello.seq_head} is not the one the server has read"
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
    if hello.epoch_last < record.epoch_seen:
        return HelloAnswer(
            "quarantine",
            "host.epoch_regressed",
            f"the host has spoken in session {record.epoch_seen}, its journal knows "
            f"{hello.epoch_last}",
        )
    return HelloAnswer("normal")


@dataclass(frozen=True, slots=True, kw_only=True)
class Opening:
    """The session that follows from a HELLO."""

    record: HostRecord
    """What to remember before the WELCOME is sent."""

    state: SessionState
    mode: str
    """`normal` or `quarantine`, for the WELCOME."""


def after_hello(record: HostRecord, hello: Hello, answer: HelloAnswer) -> Opening:
    """Give a host that is not refused a session under a fresh epoch.

    A host in quarantine gets one too: it learns the raised floor by it, and is disarmed.
    """
    if answer.kind == "quarantine":
        return Opening(
            record=quarantined(record, answer.code),
            state=SessionState.QUARANTINED,
            mode="quarantine",
        )
    boots = record.boots
    if boots[-1:] != (hello.boot_id,):
        boots = (*boots, hello.boot_id)[-MOST_BOOTS:]
    fresh = replace(record, epoch=record.epoch + 1, journal_id=hello.journal_id, boots=boots)
    return Opening(record=fresh, state=SessionState.SYNCING, mode="normal")


def quarantined(record: HostRecord, code: str) -> HostRecord:
    """Fence a host whose log cannot be trusted: its session ends, what it was given is void.

    Every job that was dispatched to it is in doubt from here on.
    """
    return replace(
        record,
        epoch=record.epoch + 1,
        floor=max(record.floor, record.last_dseq + 1),
        quarantine=record.quarantine or code,
    )


def heard(record: HostRecord) -> HostRecord:
    """Remember that the host has spoken in the present session: its disk knows the epoch."""
    return replace(record, epoch_seen=record.epoch)


def fenced(record: HostRecord) -> HostRecord:
    """Declare a host lost: two people say that it is dead and can move nothing any more.

    It is a quarantine whose jobs need not wait for the host: people answer for them.
    """
    return replace(quarantined(record, FENCED_CODE), quarantine=FENCED_CODE)


MAY_BE_FENCED = frozenset({SessionState.ISOLATED, SessionState.QUARANTINED})
"""States of a host that two people may declare lost: one that answers is not lost."""


def check_fence(state: SessionState, first_by: str | None, actor: str) -> HelloAnswer | None:
    """Say what speaks against a signature under the fence of a host; None: nothing.

    Args:
        state: How the server sees the host.
        first_by: Who signed first; None: nobody has.
        actor: Who signs now.
    """
    if state not in MAY_BE_FENCED:
        text = f"a host that is {state.value} is not lost"
        return HelloAnswer("refuse", "host.not_lost", text)
    if first_by == actor:
        text = "the second signature is another person's"
        return HelloAnswer("refuse", "host.same_person", text)
    return None


def readmitted(record: HostRecord) -> HostRecord:
    """Let a host begin again with a new journal, after a person took stock beside it.

    The old journal was set aside with every process of the host down, so nothing that it
    had accepted can start any more; its epoch and the floor void what is still on its way.
    The caller closes the host's connections: a HELLO of the old journal may wait on one.
    """
    return replace(
        record,
        epoch=record.epoch + 1,
        journal_id=None,
        acked_seq=0,
        hash_at_acked="",
        epoch_seen=0,
        boots=(),
        quarantine="",
    )


def is_given_up(record: HostRecord, dseq: int) -> bool:
    """Say whether a person's answer settles an action on the server.

    Only where its host can never tell: the action was fenced, and the host has begun another
    journal since, or two people have declared it lost. Every other answer goes to the host as
    a command.
    """
    if dseq >= record.floor:
        return False
    if record.quarantine:
        return record.quarantine == FENCED_CODE
    return record.journal_id is not None


def is_caught_up(acked_seq: int, seq_head: int) -> bool:
    """Say whether the server has read all that a host's HELLO announced."""
    return acked_seq >= seq_head


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
    if record.quarantine:
        return Intake(code="host.quarantined", message="a person has to readmit this host")
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


def state_by_beat(current: SessionState, *, is_resumed: bool) -> SessionState:
    """Return the state after a sign of life in the present session.

    A host whose log the server had not read to its end when it fell silent is not online
    by a heartbeat alone.
    """
    if current not in {SessionState.SUSPECT, SessionState.ISOLATED}:
        return current
    return SessionState.ONLINE if is_resumed else SessionState.SYNCING
