"""One wish, one effect: what was answered to a key is the answer to each repetition."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import timedelta

from cryptography.fernet import Fernet
from django.db import connection
from django.db.transaction import atomic
from django.db.utils import OperationalError
from psycopg.errors import LockNotAvailable

from labweb.accounts.models import KeptAnswer, User
from labweb.common.clock import now

KEPT_FOR = timedelta(days=7)
"""How long the answer to a key is kept: a request that comes later is another wish."""

_TAKE_TURN = """
SELECT set_config('lock_timeout', '2s', true), pg_advisory_xact_lock(%s),
       set_config('lock_timeout', '0', true)
"""
"""Wait until no request with the same key is being carried out, for two seconds at most. What a
SELECT lists is evaluated from left to right."""


class KeyOfAnotherRequestError(Exception):
    """The key was given to another request before."""


class KeyInUseError(Exception):
    """A request with this key is being carried out."""


@dataclass(frozen=True, slots=True)
class WishAnswer:
    """What a request was answered."""

    status: int
    content: bytes
    headers: Mapping[str, str]
    is_replayed: bool = False
    """It is the first answer; nothing was carried out for it now."""


def carry_out_once(
    act: Callable[[], WishAnswer], *, actor: User, key: str, digest: str
) -> WishAnswer:
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
        KeyOfAnotherRequestError: The key belongs to another request; nothing was carried out.
        KeyInUseError: The first one has not ended within two seconds.

    Effect:
        That of `act`, or none.
    """
    with atomic():
        _take_turn(actor, key)
        first = find_answer(actor=actor, key=key, digest=digest)
        if first is not None:
            return first
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


def find_answer(*, actor: User, key: str, digest: str) -> WishAnswer | None:
    """Return what the request was answered before; None: this is the first with its key.

    Args:
        actor: In whose name.
        key: What the sender named its wish with.
        digest: SHA-256 of the request, hex.

    Raises:
        KeyOfAnotherRequestError: The key belongs to another request.
    """
    kept = KeptAnswer.objects.filter(user=actor, key_digest=_key_digest(key)).first()
    if kept is None:
        return None
    if kept.request_digest != digest:
        raise KeyOfAnotherRequestError
    return replace(_opened(kept, key), is_replayed=True)


def _take_turn(actor: User, key: str) -> None:
    """Wait for the turn of the key, which this transaction then has."""
    turn = hashlib.sha256(f"{actor.pk} {key}".encode()).digest()
    try:
        with connection.cursor() as cursor:
            cursor.execute(_TAKE_TURN, [int.from_bytes(turn[:8], signed=True)])
    except OperationalError as error:
        if isinstance(error.__cause__, LockNotAvailable):
            raise KeyInUseError from error
        raise


def _key_digest(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()


def _seal(key: str) -> Fernet:
    return Fernet(base64.urlsafe_b64encode(hashlib.sha256(f"answer {key}".encode()).digest()))


def _sealed(answer: WishAnswer, key: str) -> bytes:
    told = [answer.status, dict(answer.headers), answer.content.decode()]
    return _seal(key).encrypt(json.dumps(told).encode())


def _opened(kept: KeptAnswer, key: str) -> WishAnswer:
    status, headers, content = json.loads(_seal(key).decrypt(bytes(kept.sealed)))
    return WishAnswer(status, content.encode(), headers)


def forget_answers() -> int:
    """Delete the answers that are older than `KEPT_FOR`; return how many."""
    count, _ = KeptAnswer.objects.filter(at__lt=now() - KEPT_FOR).delete()
    return count
