"""What the endpoints of the session answer with."""

from __future__ import annotations

from typing import Literal
from uuid import UUID

from labweb.common.answers import ApiAnswer
from labweb.domain.approvals.role_permissions import Permission
from labweb.runs.answers.lab import LabSummary

PasswordMaker = Literal["own", "admin", "seed"]


class SignedInUser(ApiAnswer):
    """The person who is signed in."""

    id: UUID
    username: str
    name: str
    initials: str
    roles: list[str]
    password_from: PasswordMaker
    """Who chose the password: themselves, an admin, or the start of a simulated lab."""

    permissions: list[Permission]
    """What they may do somewhere in the lab."""

    lab_permissions: list[Permission]
    """What they may do to all of the lab."""


class OpenSession(ApiAnswer):
    """Who is signed in, and the lab as every page shows it."""

    user: SignedInUser | None
    """Null: nobody is."""

    lab: LabSummary | None
    """Null: nobody is signed in, or no lab was imported yet."""


class PasswordConfirmed(ApiAnswer):
    """The password was typed again, and is right."""

    holds_s: float
    """For how long acts are signed with it."""
