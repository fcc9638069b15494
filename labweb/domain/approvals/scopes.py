"""What a program may do that comes with the access token of a person."""

from __future__ import annotations

from enum import StrEnum


class Scope(StrEnum):
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

    def holds(self, other: Scope) -> bool:
        """Tell whether this scope allows what another one asks for."""
        order = list(Scope)
        return order.index(self) >= order.index(other)
