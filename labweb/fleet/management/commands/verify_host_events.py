"""Check that no event that a host has told was edited, removed or moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from labweb.accounts.management.chain_command import VerifyCommand
from labweb.domain.errors import Finding
from labweb.domain.messages.chain_heads import Countersigned
from labweb.enrollment import selectors as enrollment_selectors
from labweb.fleet.selectors.host_chain import first_broken_host_event
from labweb.resources import selectors as resource_selectors


class Command(VerifyCommand):
    """`manage.py verify_host_events`."""

    has_heads = False
    help = "Check what hosts have told against its hashes. Exit code 1 names the first broken row."

    def first_breaks(self, _kept: Sequence[Countersigned]) -> Mapping[str, Finding | None]:
        """Return the first broken event of each host, by lab and host."""
        return {
            f"{lab.key}: {host.name}": first_broken_host_event(host)
            for lab in resource_selectors.labs().order_by("key")
            for host in enrollment_selectors.hosts_of(lab)
        }
