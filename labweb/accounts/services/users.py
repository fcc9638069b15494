"""Writes about people and their passwords."""

from __future__ import annotations

from uuid import UUID

from django.contrib.auth.password_validation import validate_password
from django.core.exceptions import ValidationError
from django.db.transaction import atomic

from labweb.accounts.models import Grant, User
from labweb.accounts.services.access_tokens import revoke_all
from labweb.accounts.services.audit_trail import write_audit
from labweb.domain.errors import DefinitionError, ForbiddenError

PasswordFrom = User.PasswordFrom


@atomic
def ensure_user(
    username: str,
    *,
    full_name: str,
    password: str,
    role: str,
    root_id: UUID,
    password_from: PasswordFrom = PasswordFrom.OWN,
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
            "password_from": password_from,
        },
    )
    if created:
        user.set_password(password)
        user.save(update_fields=["password"])
    Grant.objects.get_or_create(user=user, role=role, resource_id=root_id)
    return user, created


@atomic
def change_password(user: User, *, old: str, new: str) -> User:
    """Let a person choose a new password for themselves.

    Raises:
        ForbiddenError: The present password is another one. Nothing changed.
        DefinitionError: The new one is too weak, or the present one again. Nothing changed.

    Effect:
        On the record only. Every other session of the person ends, and their access tokens
        are revoked.
    """
    row = User.objects.select_for_update(no_key=True).get(pk=user.pk)
    if not row.check_password(old):
        raise ForbiddenError("the current password is wrong", code="session.wrong")
    if old == new:
        text = "this is the current password: choose another one"
        raise DefinitionError(text, code="session.same_password")
    try:
        validate_password(new, row)
    except ValidationError as error:
        text = " ".join(error.messages)
        raise DefinitionError(text, code="session.weak_password") from error
    row.set_password(new)
    row.password_from = PasswordFrom.OWN
    row.save(update_fields=["password", "password_from"])
    revoke_all(row, actor=row)
    write_audit("user.password", str(row.pk), actor=row)
    return row


@atomic
def note_foreign_password(user: User) -> None:
    """Have a person change a password that somebody else has set for them.

    Their access tokens are revoked: whoever made them may have known the password before.
    """
    user.password_from = PasswordFrom.ADMIN
    user.save(update_fields=["password_from"])
    revoke_all(user, actor=None)
