"""Check that no decision was edited, removed, exchanged or written again."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.accounts.selectors.chain import kept_heads
from labweb.approvals.selectors import first_broken_decision


class Command(BaseCommand):
    """`manage.py verify_decisions`."""

    help = "Check the decisions and their signed heads. Exit code 1 names the first broken row."

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
        found = first_broken_decision(kept_heads(options["heads"]))
        if options["json"]:
            plain = None if found is None else found.to_json()
            self.stdout.write(json.dumps({"whole": found is None, "decisions": plain}, indent=2))
        else:
            self.stdout.write("whole" if found is None else f"{found.code}: {found.message}")
        if found is not None:
            raise CommandError("the chain of decisions is broken", returncode=1)
