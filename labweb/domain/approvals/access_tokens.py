"""What a program may do that comes with the access token of a person, and for how long."""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime
from enum import StrEnum

from labweb.domain.errors import DefinitionError, StateError

MOST_DAYS = 366
"""No token is valid for longer."""

MOST_TOKENS = 20
"""Valid tokens of one person in one lab."""

LONGEST_NAME = 100


class AccessScope(StrEnum):
    """How far an access token reaches: each scope holds all before it.

    A token never does more than its owner may, and no token approves, answers a doubt, releases
    the lab, admits anything, or signs: for that a person signs in.
    """

    READ = "read"
    DRAFT = "draft"
    """Draw, check and save workflows and recipes."""

    SIMULATE = "simulate"
    """Start, pause and abort own runs where the instruments are simulated; stop a lab."""

    SUBMIT = "submit"
    """The same in any lab. What asks for an approval still waits for a person."""

    def holds(self, other: AccessScope) -> bool:
        """Tell whether this scope allows what another one asks for."""
        order = list(AccessScope)
        return order.index(self) >= order.index(other)


def check_wanted(name: str, days: int, valid: Collection[str]) -> None:
    """Refuse a token that nobody may make.

    Args:
        name: What the person calls it.
        days: For how many days it is to be valid.
        valid: Names of the person's tokens that are valid now.

    Raises:
        DefinitionError: The name is empty or too long, or the days are not 1 to 366.
        StateError: There is a valid token of that name, or there are too many.
    """
    if not name or len(name) > LONGEST_NAME:
        text = f"name a token with 1 to {LONGEST_NAME} characters"
        raise DefinitionError(text, code="token.name")
    if not 1 <= days <= MOST_DAYS:
        text = f"a token is valid for 1 to {MOST_DAYS} days, not {days}"
        raise DefinitionError(text, code="token.days")
    if name in valid:
        text = f"you have a token {name!r} already: revoke it first, or choose another name"
        raise StateError(text, code="token.name_taken")
    if len(valid) >= MOST_TOKENS:
        text = f"you have {MOST_TOKENS} valid tokens, and nobody may have more: revoke one first"
        raise StateError(text, code="token.too_many")


def is_valid(expires_at: datetime, revoked_at: datetime | None, at: datetime) -> bool:
    """Tell whether a token opens anything at a time."""
    return revoked_at is None and expires_at > at
