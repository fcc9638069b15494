"""Check that no event was edited, deleted or reordered."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.accounts.selectors.chain import kept_heads
from labweb.crutd.selectors.chain import first_broken_event, first_broken_signed_head
from labweb.resources import selectors as resource_selectors


class Command(BaseCommand):
    """`manage.py verify_events`."""

    help = "Check each lab's events and their signed heads. Exit code 1 names the first broken row."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("--json", action="store_true", help="print JSON instead of lines")
        parser.add_argument("--heads", type=Path, help="a file that export_heads wrote earlier")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Check every lab; changes nothing.

        Raises:
            CommandError: A chain is broken (exit code 1); its first broken row was printed.
            DefinitionError: The file is no file of heads.
        """
        labs = list(resource_selectors.labs().order_by("key"))
        kept = kept_heads(options["heads"])
        found = {
            lab.key: first_broken_event(lab) or first_broken_signed_head(lab, kept) for lab in labs
        }
        broken = [key for key, finding in found.items() if finding is not None]
        if options["json"]:
            plain = {key: None if one is None else one.to_json() for key, one in found.items()}
            self.stdout.write(json.dumps({"whole": not broken, "labs": plain}, indent=2))
        else:
            for key, finding in found.items():
                text = "whole" if finding is None else f"{finding.code}: {finding.message}"
                self.stdout.write(f"{key}: {text}")
        if broken:
            raise CommandError(f"the chain is broken in {', '.join(broken)}", returncode=1)
