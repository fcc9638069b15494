"""Replay the events of every lab: compare what they tell with the rows, or write it anew."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.domain.errors import Finding, LabError
from labweb.records.services import event_file, ledger_rebuild
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


class Command(BaseCommand):
    """`manage.py rebuild [--check | --from FILE]`."""

    help = (
        "Write tree, lots, ledger, transactions and jobs of every lab anew from its import and "
        "its events; with --check compare them only, and write nothing; with --from make a lab "
        "in an empty database of a file that export_events wrote."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        what = parser.add_mutually_exclusive_group()
        what.add_argument(
            "--check", action="store_true", help="compare with the rows, write nothing"
        )
        what.add_argument("--from", type=Path, dest="file", help="file of events")
        parser.add_argument("--json", action="store_true", help="print JSON instead of lines")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Rebuild or compare.

        Raises:
            CommandError: Something differs, or cannot be rebuilt (exit code 1); each difference
                was printed. A lab that cannot be rebuilt is left as it was.
        """
        if options["file"] is not None:
            self._restore(options["file"])
        labs = list(resource_selectors.labs().order_by("key"))
        if not options["check"] and options["file"] is None:
            for lab in labs:
                self._rebuild(lab)
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

    def _restore(self, path: Path) -> None:
        try:
            lab = event_file.restore(path)
        except OSError as error:
            raise CommandError(f"cannot read the file: {error}", returncode=1) from error
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}", returncode=1) from error
        self.stderr.write(f"{lab.key}: made from {path}")

    def _rebuild(self, lab: Lab) -> None:
        before = len(_compare(lab))
        try:
            ledger_rebuild.rebuild(lab)
        except LabError as error:
            for finding in error.findings:
                self.stdout.write(f"  {finding.code}: {finding.message}")
            raise CommandError(f"{error.code}: {error.message}", returncode=1) from error
        self.stderr.write(f"{lab.key}: rebuilt; {before} differences before")


def _compare(lab: Lab) -> list[Finding]:
    try:
        return ledger_rebuild.differences(lab)
    except LabError as error:
        return [Finding(error.code, error.message, str(lab.id), error.context)]
