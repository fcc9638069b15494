"""Seed the embedded default from a lab file."""

from __future__ import annotations

import hashlib
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.domain.errors import LabError
from labweb.domain.graph.lab_file.binding_file import read_binding
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.recipes.graph_formats.lab_of_any_format import Format, LabDocument
from labweb.runs.services.seed import seed

BINDINGS = Path(__file__).parents[4] / "fixtures" / "bindings"


class Command(BaseCommand):
    """`manage.py seed`."""

    help = "Import a lab once, and write users, devices, simulated instruments and host files."
    requires_system_checks = ()

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("--lab", type=Path, required=True, help="lab file to run")
        parser.add_argument("--bind", type=Path, help="binding of classes to drivers")
        parser.add_argument("--data", type=Path, required=True, help="data directory of the lab")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Seed, or say why not; a refusal changes nothing."""
        path: Path = options["lab"]
        try:
            lab_file = self._read(path, options["bind"])
            seed(
                lab_file,
                data=options["data"].resolve(),
                templates=path.parent / "workflows",
                source={
                    "file": path.name,
                    "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
                },
            )
        except OSError as error:
            raise CommandError(f"cannot read the lab file: {error}") from error
        except LabError as error:
            lines = [f"  {f.code}  {f.subject}: {f.message}" for f in error.findings]
            raise CommandError("\n".join([f"{error.code}: {error.message}", *lines])) from error

    def _read(self, path: Path, bind: Path | None) -> LabFile:
        raw = path.read_bytes()
        document = LabDocument(raw, path.stem)
        if document.format is Format.LABWEB:
            return document.read()
        path = bind or BINDINGS / f"{document.format}.json"
        bound, notes = document.bound(read_binding(path.read_bytes()))
        for note in notes:
            self.stdout.write(f"note: {note.subject}: {note.message}")
        return bound
