"""What a session with the server leaves in the journal."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from uuid import UUID

import msgspec

from labweb.domain.messages.chain_heads import Heads, countersigned_bytes
from labweb.domain.messages.devices_and_drivers import DevicesFrame
from labweb.domain.messages.session import Heartbeat, Hello, Welcome
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.host_actions import host_state
from labweb.domain.runs.host_journal.countersigned_heads import write_head
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import JournalError
from workers.base import faults
from workers.base.disk_space import disk_space_of
from workers.base.host_key import HostKey
from workers.base.signatures import is_signature
from workers.journal.journal import Journal
from workers.sandbox.confinement import describe

log = logging.getLogger(__name__)


def make_hello(
    journal: Journal, key: HostKey, nonce: str, instance_id: str = "", pace: float = 1.0
) -> Hello:
    """Say who this host is and where its journal stands, and prove it."""
    host = journal.host_state()
    seq, digest = journal.head()
    seal = journal.seal()
    hello = Hello(
        host_id=journal.host_id,
        journal_id=journal.journal_id,
        boot_id=journal.boot_id,
        armed_boot_id=host.armed_boot_id,
        epoch_last=host.epoch,
        seq_head=seq,
        hash_head=digest,
        acked_seq=journal.acked_seq(),
        seal_seq=0 if seal is None else seal.seq,
        regression=journal.regression() or "",
        open_actions=journal.open_ids(),
        instance_id=instance_id,
        software=f"labweb {version('labweb')}",
        pace=pace,
    )
    return msgspec.structs.replace(hello, signature=key.sign_hello(hello, nonce))


def open_session(journal: Journal, welcome: Welcome, asked_at: HostMoment | None = None) -> None:
    """Remember the session before anything is sent in it.

    Args:
        journal: The host's.
        welcome: The server's answer.
        asked_at: Before HELLO was sent; None: what the answer says of clocks counts for nothing.
    """
    with journal.write() as tx:
        host_state.write_welcome(tx, welcome)
        if asked_at is not None:
            host_state.write_server_clock(tx, welcome.tick, asked_at)


def make_heartbeat(
    journal: Journal,
    folder: Path,
    alive: Mapping[str, float],
    *,
    epoch: int,
    asked_s: float | None = None,
    serving: dict[str, str] | None = None,
) -> Heartbeat:
    """Say that this host lives, and how it stands.

    Args:
        journal: The host's.
        folder: Its data directory, whose disk may fill up.
        alive: When each line was seen alive last, on the clock of `time.monotonic`.
        epoch: Session in which it is sent.
        asked_s: What the server is to say back, so that its clock is measured.
        serving: Digests of the versions that serve, where they changed.
    """
    now_s = time.monotonic()
    host = journal.host_state()
    return Heartbeat(
        epoch=epoch,
        mono_s=now_s,
        seq_head=journal.head()[0],
        stop_latched=host.stop_latched,
        **disk_space_of(folder),
        lines={line: now_s - at_s for line, at_s in alive.items()},
        wall_s=time.time(),
        asked_s=asked_s,
        open_count=journal.open_count(),
        confinement="unconfined: faults are armed" if faults.are_armed() else describe(),
        serving=serving,
        halts_owed=frozenset(map(UUID, host.owes_halt)),
    )


def take_devices(journal: Journal, told: DevicesFrame) -> None:
    """Remember what the host serves and makes ready from now on."""
    with journal.write() as tx:
        host_state.write_devices(tx, told.devices, told.staged)


def record_ack(journal: Journal, seq: int) -> None:
    """Remember how far the server has committed; the server tells it again in each session.

    So a disk that refuses it ends no connection: the server goes on hearing what is the matter.
    """
    try:
        with journal.write(is_durable=False) as tx:
            host_state.write_ack(tx, seq)
    except JournalError as error:
        log.warning("how far the server is cannot be written now: %s", error)


def arm(journal: Journal) -> bool:
    """Let this start of the machine begin new work; False: the journal is not the newest."""
    regression = journal.regression()
    with journal.write() as tx:
        return host_state.write_armed(tx, journal.boot_id, regression)


def disarm_if_regressed(journal: Journal) -> str | None:
    """Disarm a journal that is not the newest one; return why, or None."""
    reason = journal.regression()
    if reason is not None and journal.host_state().armed_boot_id is not None:
        with journal.write() as tx:
            host_state.write_disarmed(tx)
    return reason


def record_boot(journal: Journal) -> None:
    """Tell, once for each start of the machine, that it has started."""
    with journal.write() as tx:
        host_state.write_boot(tx, journal.boot_id)


def lose_link(journal: Journal) -> None:
    """Remember that the server is away, and stop the batches that want it so.

    Effect:
        Actions of such a batch that act are halted by their lines, as for a cancel.
    """
    with journal.write() as tx:
        host_state.write_link_lost(tx, journal.moment())
    # It may have been written by a process that died before the seal moved: a copy of the
    # journal from before would then begin the time anew.
    journal.seal_up()


def countersign(journal: Journal, key: HostKey, heads: Heads) -> None:
    """Keep the heads of the server's chains whose signature holds, and sign each of them.

    Effect:
        On the record only. A chain that is shorter than it was, or another one, is told of.
    """
    sound = [
        one for one in heads.signed if is_signature(heads.key, one.body.encode(), one.signature)
    ]
    if len(sound) < len(heads.signed):
        log.warning("%d heads bear no signature of their key", len(heads.signed) - len(sound))
    if not sound:
        return
    with journal.write() as tx:
        for one in sound:
            write_head(tx, heads.key, one, key.sign(countersigned_bytes(heads.key, one)))


def latch_stop(journal: Journal, stop: StopLabFrame) -> None:
    """Close the stop latch. Only a signed Reset opens it."""
    with journal.write() as tx:
        host_state.write_stop(tx, stop)
