"""Check that no entry of the audit trail was edited, removed, exchanged or written again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from labweb.accounts.management.chain_command import VerifyCommand
from labweb.accounts.selectors import hash_chains
from labweb.domain.errors import Finding
from labweb.domain.messages.chain_heads import Countersigned


class Command(VerifyCommand):
    """`manage.py verify_audit`."""

    help = "Check the audit trail and its signed heads. Exit code 1 names the first broken row."

    def first_breaks(self, kept: Sequence[Countersigned]) -> Mapping[str, Finding | None]:
        """Return the first broken row of the audit trail."""
        found = hash_chains.first_broken_entry() or hash_chains.first_broken_head(
            hash_chains.AUDIT, hash_chains.audit_hash_at, kept
        )
        return {"audit trail": found}
