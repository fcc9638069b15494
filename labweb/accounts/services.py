"""Writes of users, grants and the audit trail."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from typing import Any
from uuid import UUID

from cryptography.fernet import Fernet
from django.db import connection
from django.db.transaction import atomic
from django.db.utils import OperationalError
from psycopg.errors import LockNotAvailable

from labweb.accounts.models import AuditEntry, Grant, KeptAnswer, User
from labweb.common.clock import now
from labweb.common.prepared import Question, insert_rows, together
from labweb.domain.messages import canonical

_AUDIT_LOCK = 0x6C61_6261

_AUDIT_LOCK = 0x6C61_6262


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


KEPT_FOR = timedelta(days=7)
"""How long the answer to a key is kept: a request that comes later is another wish."""

_TAKE_TURN = """
SELECT set_config('lock_timeout', '2s', true), pg_advisory_xact_lock(%s),
       set_config('lock_timeout', '0', true)
"""
"""Wait until no request with the same key is being carried out, for two seconds at most. What a
SELECT lists is evaluated from left to right."""


class KeyReusedError(Exception):
    """The key was given to another request before."""


class InProgressError(Exception):
    """A request with this key is being carried out."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a request was answered."""

    status: int
    content: bytes
    headers: Mapping[str, str]
    is_replayed: bool = False
    """It is the first answer; nothing was carried out for it now."""


def carry_out_once(act: Callable[[], Answer], *, actor: User, key: str, digest: str) -> Answer:
    """Carry out what a request asks for, unless it was carried out by the same key before.

    The effect and the answer are written in one atomic block: either both are there, also after
    a crash, or neither. Two requests with one key at once: the second waits for the first.

    Args:
        act: Carries it out in this block and returns the answer, also to what is refused.
            What it raises takes everything back, as `set_rollback` does, and no answer is kept.
        actor: In whose name; keys of others are other keys.
        key: What the sender named its wish with.
        digest: SHA-256 of the request, hex.

    Raises:
        KeyReusedError: The key belongs to another request; nothing was carried out.
        InProgressError: The first one has not ended within two seconds.

    Effect:
        That of `act`, or none.
    """
    with atomic():
        kept = _kept(actor, key)
        if kept is not None and kept.request_digest != digest:
            raise KeyReusedError
        if kept is not None:
            return replace(_opened(kept, key), is_replayed=True)
        answer = act()
        if connection.needs_rollback:
            return answer
        KeptAnswer.objects.create(
            user=actor,
            key_digest=_key_digest(key),
            request_digest=digest,
            sealed=_sealed(answer, key),
            at=now(),
        )
    return answer


def _kept(actor: User, key: str) -> KeptAnswer | None:
    """Wait for the turn of the key, which this transaction then has, and find its answer."""
    turn = hashlib.sha256(f"{actor.pk} {key}".encode()).digest()
    try:
        with connection.cursor() as cursor:
            cursor.execute(_TAKE_TURN, [int.from_bytes(turn[:8], signed=True)])
    except OperationalError as error:
        if isinstance(error.__cause__, LockNotAvailable):
            raise InProgressError from error
        raise
    return KeptAnswer.objects.filter(user=actor, key_digest=_key_digest(key)).first()


def _key_digest(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()


def _seal(key: str) -> Fernet:
    return Fernet(base64.urlsafe_b64encode(hashlib.sha256(f"answer {key}".encode()).digest()))


def _sealed(answer: Answer, key: str) -> bytes:
    told = [answer.status, dict(answer.headers), answer.content.decode()]
    return _seal(key).encrypt(json.dumps(told).encode())


def _opened(kept: KeptAnswer, key: str) -> Answer:
    status, headers, content = json.loads(_seal(key).decrypt(bytes(kept.sealed)))
    return Answer(status, content.encode(), headers)


def forget_answers() -> int:
    """Delete the answers that are older than `KEPT_FOR`; return how many."""
    count, _ = KeptAnswer.objects.filter(at__lt=now() - KEPT_FOR).delete()
    return count
