"""Write what runs measured as a data set, with the full lineage of every value."""

from __future__ import annotations

import shutil
import tempfile
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.domain.errors import LabError
from labweb.records.services.dataset import write_values
from labweb.records.services.open_reaction_database import write_ord
from labweb.runs import selectors
from labweb.runs.selectors import Run


class Command(BaseCommand):
    """`manage.py export_dataset`."""

    help = "Write every measured value of some runs as Parquet, and the runs as ORD reactions."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("--runs", nargs="+", required=True, help="ids or numbers of runs")
        parser.add_argument("--out", type=Path, required=True, help="folder that is not there yet")
        parser.add_argument("--ord", action="store_true", help="write dataset.pb and .json too")
        parser.add_argument("--contact", default="", help="address for the ORD record")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Export all of it, or say why not.

        Raises:
            CommandError: A run is not known, or something of it cannot be written (exit code 1).
        """
        out: Path = options["out"]
        if options["ord"] and not options["contact"]:
            raise CommandError("ORD asks for who answers for the record: name --contact ADDRESS")
        if out.exists():
            raise CommandError(f"{out} is there already")
        try:
            runs = [selectors.named_run(text) for text in dict.fromkeys(options["runs"])]
            half = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
            try:
                told = self._write(runs, half, options)
                half.chmod(0o755)
                half.rename(out)
            finally:
                shutil.rmtree(half, ignore_errors=True)
        except LabError as error:
            for finding in error.findings:
                self.stderr.write(f"{finding.code}  {finding.message}")
            raise CommandError(f"{error.code}: {error.message}") from error
        except OSError as error:
            raise CommandError(f"cannot write the data set: {error}") from error
        self.stdout.write(f"{out}: {told}")

    def _write(self, runs: list[Run], folder: Path, options: dict[str, Any]) -> str:
        told = f"{write_values(runs, folder / 'values.parquet')} values of {len(runs)} runs"
        if options["ord"]:
            count = write_ord(runs, folder, contact=options["contact"])
            told += f", {count} reactions"
        return told
