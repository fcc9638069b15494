"""Writes of users, grants, the audit trail and its signed heads."""

from __future__ import annotations

from labweb.accounts.services.access_tokens import (
    make_token,
    note_use,
    revoke_token,
)
from labweb.accounts.services.audit_trail import (
    acting_token,
    end_of_audit,
    write_audit,
    write_failed_sign_in,
    write_refusal,
)
from labweb.accounts.services.idempotency import (
    KEPT_FOR,
    KeyInUseError,
    KeyOfAnotherRequestError,
    WishAnswer,
    carry_out_once,
    find_answer,
    forget_answers,
)
from labweb.accounts.services.signed_heads import sign_chain
from labweb.accounts.services.users import (
    PasswordFrom,
    change_password,
    ensure_user,
    note_foreign_password,
)

__all__ = [
    "KEPT_FOR",
    "KeyInUseError",
    "KeyOfAnotherRequestError",
    "PasswordFrom",
    "WishAnswer",
    "acting_token",
    "carry_out_once",
    "change_password",
    "end_of_audit",
    "ensure_user",
    "find_answer",
    "forget_answers",
    "make_token",
    "note_foreign_password",
    "note_use",
    "revoke_token",
    "sign_chain",
    "write_audit",
    "write_failed_sign_in",
    "write_refusal",
]
