"""Write the lab as a file."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from labweb.crutd.selectors.lab_export import lab_file_of
from labweb.domain.errors import LabError
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.uni_lab_os.graph_write import export_uni_lab_os
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab

FORMATS = ("labweb", "uni-lab-os")


class Command(BaseCommand):
    """`manage.py export_lab`."""

    help = "Write the lab as lab.json, or as a graph of Uni-Lab-OS."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("file", type=Path, nargs="?", help="file to write; else printed")
        parser.add_argument("--format", choices=FORMATS, default="labweb")
        parser.add_argument("--lab", help="key of the lab, when there are several")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Export, or say why not.

        Raises:
            CommandError: There is no such lab, or the file cannot be written (exit code 1).
        """
        try:
            lab_file = lab_file_of(_lab(options["lab"]))
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error
        text = _rendered(lab_file, options["format"])
        path: Path | None = options["file"]
        if path is None:
            self.stdout.write(text, ending="")
            return
        try:
            path.write_text(text, "utf-8")
        except OSError as error:
            raise CommandError(f"cannot write the file: {error}") from error


def _lab(key: str | None) -> Lab:
    if key is None:
        return resource_selectors.the_lab()
    found = resource_selectors.labs().filter(key=key).first()
    if found is None:
        raise CommandError(f"no lab has the key {key!r}")
    return found


def _rendered(lab_file: LabFile, form: str) -> str:
    if form == "labweb":
        return render_lab(lab_file).decode()
    value = export_uni_lab_os(lab_file)
    return json.dumps(value, ensure_ascii=False, indent=2, allow_nan=False) + "\n"
