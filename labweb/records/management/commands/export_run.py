"""Write a run as an RO-Crate."""

from __future__ import annotations

import shutil
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.domain.errors import LabError
from labweb.records.services.electronic_lab_notebook import pack_eln
from labweb.records.services.ro_crate import pack_run
from labweb.runs import selectors


class Command(BaseCommand):
    """`manage.py export_run`."""

    help = "Write a run with all that belongs to it as an RO-Crate (ZIP) or .eln file."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("run", help="id or number of the run")
        parser.add_argument("--out", type=Path, required=True, help="file to write")
        parser.add_argument(
            "--format", choices=["crate", "eln"], default="crate", help="eln: for lab notebooks"
        )

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Export, or say why not.

        Raises:
            CommandError: There is no such run, or the file cannot be written (exit code 1).
        """
        out: Path = options["out"]
        try:
            pack = pack_eln if options["format"] == "eln" else pack_run
            with pack(selectors.named_run(options["run"]), None) as packed:
                _keep(packed, out)
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error
        except OSError as error:
            raise CommandError(f"cannot write the file: {error}") from error
        self.stdout.write(f"{out}: {out.stat().st_size} bytes")


def _keep(packed: Any, out: Path) -> None:  # noqa: ANN401 - an open file
    """Write the file whole or not at all."""
    half = out.with_name(out.name + ".part")
    try:
        with half.open("wb") as file:
            shutil.copyfileobj(packed, file)
        half.replace(out)
    finally:
        half.unlink(missing_ok=True)
