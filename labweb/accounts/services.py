"""Writes of users, grants and the audit trail."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any
from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts.models import AuditEntry, Grant, User
from labweb.common.clock import now
from labweb.common.prepared import Question, insert_rows, together
from labweb.domain.messages import canonical

_AUDIT_LOCK = 0x6C61_6261


@atomic
def ensure_user(
    username: str, *, full_name: str, password: str, role: str, root_id: UUID
) -> tuple[User, bool]:
    """Create a user with a role on a subtree, unless the name is taken.

    Returns:
        The user, and whether they were created now with this password.
    """
    first, _, last = full_name.partition(" ")
    user, created = User.objects.get_or_create(
        username=username,
        defaults={
            "first_name": first,
            "last_name": last,
            "is_staff": role == "admin",
            "is_superuser": role == "admin",
        },
    )
    if created:
        user.set_password(password)
        user.save(update_fields=["password"])
    Grant.objects.get_or_create(user=user, role=role, resource_id=root_id)
    return user, created


def end_of_audit() -> tuple[Question[Any], Question[Any]]:
    """Return what locks the audit trail and reads the hash of its last row, to be asked so."""
    return (
        Question("SELECT pg_advisory_xact_lock(%s)", [_AUDIT_LOCK], tuple),
        Question("SELECT hash FROM accounts_auditentry ORDER BY id DESC LIMIT 1", [], _first),
    )


def _first(row: Sequence[Any]) -> str:
    return str(row[0])


@atomic(savepoint=False)
def write_audit(
    action: str,
    subject: str,
    *,
    actor: User | None,
    reason: str = "",
    detail: Mapping[str, Any] | None = None,
    after: Sequence[str] | None = None,
) -> AuditEntry:
    """Append who did what to which object, bound to the row before.

    Args:
        action: What was done.
        subject: To which object.
        actor: By whom; None: by the server.
        reason: Why.
        detail: What else there is to tell.
        after: What `end_of_audit` told in this transaction; None asks it.
    """
    last = together(*end_of_audit())[-1] if after is None else after
    prev = last[0] if last else ""
    at = now()
    fields = {
        "prev": prev,
        "at": at.isoformat(),
        "actor": None if actor is None else str(actor.pk),
        "action": action,
        "subject": subject,
        "reason": reason,
        "detail": dict(detail or {}),
    }
    entry = AuditEntry(
        at=at,
        actor=actor,
        action=action,
        subject=subject,
        reason=reason,
        detail=dict(detail or {}),
        prev_hash=prev,
        hash=hashlib.sha256(canonical(fields)).hexdigest(),
    )
    insert_rows([entry])
    return entry
