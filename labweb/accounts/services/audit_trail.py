"""Writes of the audit trail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from typing import Any

from django.db.transaction import atomic

from labweb.accounts.models import AuditEntry, User
from labweb.accounts.selectors.hash_chains import audit_hash
from labweb.common.clock import now
from labweb.common.database.prepared_queries import Question, insert_rows, together

acting_token: ContextVar[dict[str, str] | None] = ContextVar("acting_token", default=None)
"""Id and name of the access token that acts in this request; None: a person, or the server."""

_AUDIT_LOCK = 0x6C61_6261
_LONGEST_SUBJECT = 128


def end_of_audit() -> tuple[Question[Any], Question[Any]]:
    """Return what locks the audit trail and reads the hash of its last row, to be asked so."""
    return (
        Question("SELECT pg_advisory_xact_lock(%s)", [_AUDIT_LOCK], tuple),
        Question("SELECT hash FROM accounts_auditentry ORDER BY id DESC LIMIT 1", [], _first),
    )


def _first(row: Sequence[Any]) -> str:
    return str(row[0])


@atomic(savepoint=False)
def write_audit(  # noqa: PLR0913 - one column each
    action: str,
    subject: str,
    *,
    actor: User | None,
    reason: str = "",
    detail: Mapping[str, Any] | None = None,
    meaning: str = "",
    after: Sequence[str] | None = None,
) -> AuditEntry:
    """Append who did what to which object, bound to the row before.

    Args:
        action: What was done.
        subject: To which object.
        actor: By whom; None: by the server.
        reason: Why.
        detail: What else there is to tell.
        meaning: What the actor signs with it, in words; the name as printed on this day goes along
            (21 CFR 11.50). Empty: it is no signature.
        after: What `end_of_audit` told in this transaction; None asks it.
    """
    last = together(*end_of_audit())[-1] if after is None else after
    prev = last[0] if last else ""
    at = now()
    told = dict(detail or {})
    token = acting_token.get()
    if token is not None:
        told["token"] = token
    if meaning and actor is not None:
        told |= {"printed_name": actor.printed_name, "meaning": meaning}
    entry = AuditEntry(
        at=at,
        actor=actor,
        action=action,
        subject=subject,
        reason=reason,
        detail=told,
        prev_hash=prev,
    )
    entry.hash = audit_hash(prev, entry)
    insert_rows([entry])
    return entry


def write_failed_sign_in(username: str, *, address: str) -> AuditEntry:
    """Append that somebody could not sign in.

    The name is kept where it is somebody's: what else was typed there may be a password.
    """
    user = User.objects.filter(username__iexact=username[:150]).first()
    known = "" if user is None else str(user.pk)
    detail = {"address": address, "is_name_known": user is not None}
    return write_audit("session.refuse", known, actor=None, detail=detail)


def write_refusal(actor: User, *, method: str, path: str, code: str) -> AuditEntry:
    """Append that somebody asked for what they may not do."""
    detail = {"method": method, "code": code}
    return write_audit("access.refuse", path[:_LONGEST_SUBJECT], actor=actor, detail=detail)
