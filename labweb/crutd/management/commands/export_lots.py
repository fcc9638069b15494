"""Write what was delivered as the CSV file that `import_lots` reads."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.crutd.selectors.deliveries import deliveries_of
from labweb.domain.crutd.delivery_table import render_deliveries
from labweb.domain.errors import LabError
from labweb.resources import selectors as resource_selectors


class Command(BaseCommand):
    """`manage.py export_lots`."""

    help = "Write every lot that was received, with the vessels that it came into, as CSV."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("--out", type=Path, required=True, help="file to write")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Export, or say why not.

        Raises:
            CommandError: There is no lab, or the file cannot be written (exit code 1).
        """
        out: Path = options["out"]
        try:
            found = deliveries_of(resource_selectors.the_lab())
            half = out.with_name(out.name + ".part")
            half.write_text(render_deliveries(found), "utf-8")
            half.replace(out)
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error
        except OSError as error:
            raise CommandError(f"cannot write the file: {error}") from error
        self.stdout.write(f"{out}: {len(found)} lots")
