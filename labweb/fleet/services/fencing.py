"""Declare a host lost, revoke it, and put in doubt what it was given."""

from __future__ import annotations

import logging
from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts.selectors import User
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import StateError
from labweb.domain.runs.host_link.host_session import FENCED_CODE, SessionState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors as run_selectors
from labweb.runs.services.lost_hosts import put_in_doubt

logger = logging.getLogger(__name__)


def quarantine(host: EdgeHost, code: str, message: str) -> None:
    """End a host's session, open a ticket, and put what it was given in doubt."""
    logger.error("host %s is quarantined: %s %s", host.name, code, message)
    enrollment_services.quarantine_host(host, code, message)
    crutd_services.open_ticket(host.lab, code, message, {"host_id": str(host.id)})
    put_in_doubt(host)


@atomic
def note_quarantine(host_id: UUID) -> None:
    """Put in doubt what a host was given whose journal does not continue the known one.

    Effect:
        None on matter. A person is asked to take stock; a host that is in quarantine
        already is not asked about again.
    """
    host = enrollment_selectors.host_for_update(host_id)
    code = str(host.heartbeat.get("code", "host.quarantined"))
    message = f"{host.name} is quarantined: {host.heartbeat.get('message', 'its journal differs')}"
    known = crutd_selectors.open_tickets(host.lab).filter(code=code, detail__host_id=str(host.id))
    if not known.exists():
        crutd_services.open_ticket(host.lab, code, message, {"host_id": str(host.id)})
    put_in_doubt(host)


@atomic
def note_rival(host_id: UUID) -> None:
    """Open a ticket about a second process that speaks with a host's identity; once."""
    host = enrollment_selectors.host_for_update(host_id)
    known = crutd_selectors.open_tickets(host.lab).filter(
        code="host.rival", detail__host_id=str(host.id)
    )
    if not known.exists():
        text = f"a second process speaks with the identity of {host.name}: one of them is a copy"
        crutd_services.open_ticket(host.lab, "host.rival", text, {"host_id": str(host.id)})


@atomic
def note_version(host_id: UUID, why: str) -> None:
    """Open a ticket about a host that this server does not understand; one at a time."""
    host = enrollment_selectors.host_for_update(host_id)
    known = crutd_selectors.open_tickets(host.lab).filter(
        code="host.version", detail__host_id=str(host.id)
    )
    if not known.exists():
        logger.error("host %s has no session: %s", host.name, why)
        text = f"{host.name} has no session: {why}"
        crutd_services.open_ticket(host.lab, "host.version", text, {"host_id": str(host.id)})


@atomic
def fence_host(host_id: UUID, *, actor: User, reason: str) -> EdgeHost:
    """Sign that a host is lost; with the second signature all it was given is in doubt.

    Raises:
        As `enrollment.services.sign_fence`.

    Effect:
        None on matter. Resources of what was under way are quarantined until people answer;
        they need not wait for the host.
    """
    host, is_fenced = enrollment_services.sign_fence(host_id, actor=actor, reason=reason)
    if is_fenced:
        text = f"{host.name} was declared lost: answer for each job that it was given"
        crutd_services.open_ticket(host.lab, FENCED_CODE, text, {"host_id": str(host.id)})
        put_in_doubt(host)
    return host


@atomic
def revoke_host(host_id: UUID, *, actor: User, reason: str, with_work: bool = False) -> EdgeHost:
    """Take a host's keys away for good, and close its connection.

    Args:
        host_id: Which.
        actor: Who takes them away.
        reason: Why, for the record.
        with_work: Even though it has work: what it was given is in doubt then.

    Raises:
        As `enrollment.services.revoke_host`, and
        StateError: It has work, and nobody said that this is known.

    Effect:
        None on matter. Resources of what was under way are quarantined until people answer;
        the host is not asked any more.
    """
    host = enrollment_selectors.host_for_update(host_id)
    root = resource_selectors.root_of(host.lab)
    resource_selectors.require(actor, Permission.ADMIT, [root.id])
    count = work_count(host)
    if count and not with_work and host.state != SessionState.REVOKED.value:
        text = (
            f"{host.name} has {count} jobs that have not ended: let them end, or revoke it with "
            "its work, which puts them in doubt"
        )
        raise StateError(text, code="host.in_flight", context={"jobs_count": count})
    host = enrollment_services.revoke_host(host_id, actor=actor, reason=reason)
    if count:
        message = f"{host.name} was revoked: answer for each job that it was given"
        crutd_services.open_ticket(host.lab, "host.revoked", message, {"host_id": str(host.id)})
    put_in_doubt(host)
    return host


def work_count(host: EdgeHost) -> int:
    """Count the jobs that a host was given and that have not ended, those in doubt included."""
    return run_selectors.jobs_at(host).count() + run_selectors.doubts_at(host).count()
