"""Check that no decision was edited, removed, exchanged or written again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from labweb.accounts.management.chain_command import VerifyCommand
from labweb.approvals.selectors import first_broken_decision
from labweb.domain.errors import Finding
from labweb.domain.messages.chain_heads import Countersigned


class Command(VerifyCommand):
    """`manage.py verify_decisions`."""

    help = "Check the decisions and their signed heads. Exit code 1 names the first broken row."

    def first_breaks(self, kept: Sequence[Countersigned]) -> Mapping[str, Finding | None]:
        """Return the first broken decision."""
        return {"decisions": first_broken_decision(kept)}
