"""Sign where the chains of the record end, and let every host countersign it."""

from __future__ import annotations

import logging

from labweb.accounts import services as account_services
from labweb.accounts.selectors import hash_chains as chains
from labweb.approvals.selectors import end_of_decisions
from labweb.common.signatures import signing
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors.event_chain import chain_of, end_of_events
from labweb.domain.canonical_json import canonical
from labweb.domain.errors import StateError
from labweb.domain.messages.chain_heads import ChainHead, Heads, countersigned_bytes
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.events import EdgeEvent
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab

logger = logging.getLogger(__name__)

KINDS = frozenset({"countersigned", "head_refused"})
"""What hosts tell of heads."""


def sign_heads() -> int:
    """Sign the end of every chain that has grown, and send the heads to the hosts.

    A chain that does not go on from its last head is not signed: a ticket says so, once.

    Returns:
        How many were signed.
    """
    labs = list(resource_selectors.labs().order_by("key"))
    ends = {
        chains.AUDIT: chains.end_of_audit_chain(),
        chains.DECISIONS: end_of_decisions(),
        **{chain_of(lab): end_of_events(lab) for lab in labs},
    }
    count = 0
    for name, end in ends.items():
        try:
            count += account_services.sign_chain(name, end) is not None
        except StateError as error:
            logger.error("the end of %s is not signed: %s", name, error.message)
            for lab in labs:
                _ask(lab, error.code, error.message, {"chain": name})
    if count:
        for lab in labs:
            for host in enrollment_selectors.hosts_of(lab):
                enrollment_services.tell_host(host.id, {"type": "edge.heads"})
    return count


def heads_for_hosts() -> Heads | None:
    """Return the newest head of each chain for a host to countersign; None: there is none."""
    key = signing.record_public_key()
    signed = [chains.signed_of(row) for row in chains.newest_heads() if row.key == key]
    return Heads(key=key, signed=signed) if signed else None


def take_head_event(host: EdgeHost, event: EdgeEvent) -> None:
    """Look at what a host says of a head: its signature, and what it refuses.

    Effect:
        On the record only. A head that a host refuses, one signed with another key than before,
        and a countersignature that does not hold open a ticket, once each.
    """
    key, own = str(event.body["key"]), str(event.body["countersignature"])
    message = countersigned_bytes(key, _signed_in(event))
    detail = {"chain": str(event.body["chain"]), "host_id": str(host.id)}
    if not signing.is_signed_by(host.public_key, message, own):
        text = f"the countersignature of {host.name} on {detail['chain']} does not hold"
        _ask(host.lab, "records.bad_signature", text, detail)
    if event.body.get("code"):
        text = f"{host.name} keeps another head than the server's: {event.body['message']}"
        _ask(host.lab, str(event.body["code"]), text, detail)


def _signed_in(event: EdgeEvent) -> Signed:
    """Put the signed text of a head together again from what a host tells of it."""
    names = ("chain", "seq", "hash", "at")
    head = ChainHead(**{name: event.body[name] for name in names})
    return Signed(
        body=canonical(head).decode(),
        key_id=signing.id_of(str(event.body["key"])),
        signature=str(event.body["signature"]),
    )


def _ask(lab: Lab, code: str, text: str, detail: dict[str, str]) -> None:
    """Open a ticket about a chain, unless one is open."""
    known = crutd_selectors.open_tickets(lab).filter(code=code, detail__contains=detail)
    if not known.exists():
        advice = ". Compare the record with a backup, and with the heads that hosts keep"
        crutd_services.open_ticket(lab, code, text + advice, detail)
