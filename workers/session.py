"""What a session with the server leaves in the journal."""

from __future__ import annotations

from importlib.metadata import version

import msgspec

from labweb.domain.messages import Hello, StopLab, Welcome, canonical
from workers.journal import Journal
from workers.keys import HostKey


def make_hello(journal: Journal, key: HostKey, nonce: str) -> Hello:
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
        open_actions=journal.open_ids(),
        software=f"labweb {version('labweb')}",
    )
    return msgspec.structs.replace(hello, signature=key.sign_hello(hello, nonce))


def open_session(journal: Journal, welcome: Welcome) -> None:
    """Remember the session's epoch and floor, devices and keys, before anything is sent.

    Epoch and floor never go back. In quarantine the host is disarmed: nothing starts until
    the server resumes it.
    """
    with journal.write() as tx:
        meta = tx.meta()
        tx.set_meta("epoch", str(max(welcome.epoch, int(meta.get("epoch", 0)))))
        tx.set_meta("floor", str(max(welcome.floor, int(meta.get("floor", 0)))))
        tx.set_meta("devices", canonical(welcome.devices).decode())
        tx.set_meta("command_keys", canonical(welcome.command_keys).decode())
        if welcome.mode != "normal":
            tx.set_meta("armed_boot_id", None)


def record_ack(journal: Journal, seq: int) -> None:
    """Remember how far the server has committed; never further than there are events."""
    with journal.write() as tx:
        known = int(tx.meta().get("acked_seq", 0))
        tx.set_meta("acked_seq", str(max(known, min(seq, tx.head[0]))))


def arm(journal: Journal) -> bool:
    """Let this start of the machine begin new work; False: the journal is not the newest.

    A journal that ends before its seal, or was put back from a copy, stays disarmed
    whatever the server says: actions may have happened that it does not know of.
    """
    if journal.regression() is not None:
        return False
    with journal.write() as tx:
        if tx.meta().get("armed_boot_id") != journal.boot_id:
            tx.set_meta("armed_boot_id", journal.boot_id)
            tx.append("armed", None, {"boot_id": journal.boot_id})
    return True


def disarm_if_regressed(journal: Journal) -> str | None:
    """Disarm a journal that is not the newest one; return why, or None."""
    reason = journal.regression()
    if reason is not None and journal.host_state().armed_boot_id is not None:
        with journal.write() as tx:
            tx.set_meta("armed_boot_id", None)
    return reason


def record_boot(journal: Journal) -> None:
    """Tell, once for each start of the machine, that it has started."""
    with journal.write() as tx:
        if tx.meta().get("boot_id") != journal.boot_id:
            tx.set_meta("boot_id", journal.boot_id)
            tx.append("boot", None, {"boot_id": journal.boot_id})


def latch_stop(journal: Journal, stop: StopLab) -> None:
    """Close the stop latch. Only a signed Reset opens it."""
    with journal.write() as tx:
        if tx.meta().get("stop_id") != str(stop.stop_id):
            tx.set_meta("stop_id", str(stop.stop_id))
            body = {"stop_id": str(stop.stop_id), "issued_by": stop.issued_by}
            tx.append("stop_latched", None, body)
