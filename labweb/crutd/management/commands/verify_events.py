"""Check that no event was edited, deleted or reordered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from labweb.accounts.management.chain_command import VerifyCommand
from labweb.crutd.selectors.event_chain import first_broken_event, first_broken_signed_head
from labweb.domain.errors import Finding
from labweb.domain.messages.chain_heads import Countersigned
from labweb.resources import selectors as resource_selectors


class Command(VerifyCommand):
    """`manage.py verify_events`."""

    help = "Check each lab's events and their signed heads. Exit code 1 names the first broken row."

    def first_breaks(self, kept: Sequence[Countersigned]) -> Mapping[str, Finding | None]:
        """Return the first broken event of each lab, by the key of the lab."""
        return {
            lab.key: first_broken_event(lab) or first_broken_signed_head(lab, kept)
            for lab in resource_selectors.labs().order_by("key")
        }
