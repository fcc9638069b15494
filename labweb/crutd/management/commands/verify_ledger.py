"""Check that no matter was made or lost in the record."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.resources import selectors as resource_selectors


class Command(BaseCommand):
    """`manage.py verify_ledger`."""

    help = "Check the ledger of every lab row by row. Exit code 1 when it does not hold."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("--json", action="store_true", help="print JSON instead of lines")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Check every lab; changes nothing.

        Raises:
            CommandError: A rule is broken (exit code 1); each violation was printed.
        """
        labs = list(resource_selectors.labs().order_by("key"))
        found = {lab.key: ledger_violations(lab) for lab in labs}
        count = sum(map(len, found.values()))
        if options["json"]:
            plain = {key: [finding.to_json() for finding in rows] for key, rows in found.items()}
            self.stdout.write(json.dumps({"holds": not count, "labs": plain}, indent=2))
        else:
            for key, rows in found.items():
                self.stdout.write(f"{key}: {'holds' if not rows else f'{len(rows)} violations'}")
                for finding in rows:
                    self.stdout.write(f"  {finding.code}: {finding.message}")
        if count:
            raise CommandError(f"the ledger does not hold: {count} violations", returncode=1)
