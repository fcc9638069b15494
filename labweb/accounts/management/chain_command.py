"""What the commands that verify a chain of the record have in common."""

from __future__ import annotations

import json
from abc import abstractmethod
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from django.core.management.base import BaseCommand, CommandError

from labweb.accounts.selectors.hash_chains import kept_heads
from labweb.domain.errors import Finding
from labweb.domain.messages.chain_heads import Countersigned


class VerifyCommand(BaseCommand):
    """Read chains from end to end, and print the first row of each that does not hold."""

    has_heads: ClassVar[bool] = True
    """The server signs the ends of these chains, so that exported ones can be held against them."""

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("--json", action="store_true", help="print JSON instead of lines")
        if self.has_heads:
            parser.add_argument("--heads", type=Path, help="a file that export_heads wrote earlier")

    @abstractmethod
    def first_breaks(self, kept: Sequence[Countersigned]) -> Mapping[str, Finding | None]:
        """Return the first broken row of each chain by its name; None: it is whole.

        Args:
            kept: Signed heads that were taken out of the server earlier.
        """

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Check; changes nothing.

        Raises:
            CommandError: A chain is broken (exit code 1); its first broken row was printed.
            DefinitionError: The file is no file of heads.
        """
        found = self.first_breaks(kept_heads(options.get("heads")))
        broken = [name for name, one in found.items() if one is not None]
        if options["json"]:
            plain = {name: None if one is None else one.to_json() for name, one in found.items()}
            self.stdout.write(json.dumps({"whole": not broken, "chains": plain}, indent=2))
        else:
            for name, one in found.items():
                text = "whole" if one is None else f"{one.code}: {one.message}"
                self.stdout.write(f"{name}: {text}")
        if broken:
            raise CommandError(f"the chain is broken in {', '.join(broken)}", returncode=1)
