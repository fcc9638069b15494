"""Check that no entry of the audit trail was edited, removed, exchanged or written again."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.accounts.selectors import chain


class Command(BaseCommand):
    """`manage.py verify_audit`."""

    help = "Check the audit trail and its signed heads. Exit code 1 names the first broken row."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("--json", action="store_true", help="print JSON instead of a line")
        parser.add_argument("--heads", type=Path, help="a file that export_heads wrote earlier")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Check; changes nothing.

        Raises:
            CommandError: The chain is broken (exit code 1); its first broken row was printed.
            DefinitionError: The file is no file of heads.
        """
        kept = chain.kept_heads(options["heads"])
        found = chain.first_broken_entry() or chain.first_broken_head(
            chain.AUDIT, chain.audit_hash_at, kept
        )
        if options["json"]:
            plain = None if found is None else found.to_json()
            self.stdout.write(json.dumps({"whole": found is None, "audit": plain}, indent=2))
        else:
            self.stdout.write("whole" if found is None else f"{found.code}: {found.message}")
        if found is not None:
            raise CommandError("the audit trail is broken", returncode=1)
