"""Replay the events of every lab and compare what they tell with the rows."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.crutd.selectors.past import rebuild_differences
from labweb.domain.errors import Finding, LabError
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


class Command(BaseCommand):
    """`manage.py rebuild --check`."""

    help = "Rebuild every lab from its import and its events, and compare. Writes nothing."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument(
            "--check", action="store_true", required=True, help="compare with the rows"
        )
        parser.add_argument("--json", action="store_true", help="print JSON instead of lines")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Rebuild and compare; changes nothing.

        Raises:
            CommandError: Something differs (exit code 1); each difference was printed.
        """
        labs = list(resource_selectors.labs().order_by("key"))
        found = {lab.key: _compare(lab) for lab in labs}
        count = sum(map(len, found.values()))
        if options["json"]:
            plain = {key: [finding.to_json() for finding in rows] for key, rows in found.items()}
            self.stdout.write(json.dumps({"equal": not count, "labs": plain}, indent=2))
        else:
            for key, rows in found.items():
                self.stdout.write(f"{key}: {f'{len(rows)} differences' if rows else 'equal'}")
                for finding in rows:
                    self.stdout.write(f"  {finding.code}: {finding.message}")
        if count:
            raise CommandError(f"rows and events differ: {count} differences", returncode=1)


def _compare(lab: Lab) -> list[Finding]:
    try:
        return rebuild_differences(lab)
    except LabError as error:
        return [Finding(error.code, error.message, str(lab.id), error.context)]
