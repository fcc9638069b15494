"""Write the events of the lab, from which `rebuild --from` makes it anew elsewhere."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.domain.errors import LabError
from labweb.records.services import event_file
from labweb.resources import selectors as resource_selectors


class Command(BaseCommand):
    """`manage.py export_events FILE`."""

    help = (
        "Write import, events, what hosts told, and the rows that they speak of, as JSON lines, "
        "each bound to the one before. A broken chain, or a transaction under way, is refused."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("file", type=Path, help="file to write")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Export, or say why not.

        Raises:
            CommandError: The lab cannot be exported now, or the file cannot be written (exit
                code 1). No file is left.
        """
        path: Path = options["file"]
        try:
            count = event_file.export(resource_selectors.the_lab(), path)
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error
        except OSError as error:
            raise CommandError(f"cannot write the file: {error}") from error
        self.stdout.write(f"{path}: {count} lines")
