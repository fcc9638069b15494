"""Write a physical graph in another format, or say what that cannot hold. No database is asked."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from django.core.management.base import CommandError

from labweb.domain.errors import Finding, LabError
from labweb.domain.recipes.graph_formats.convert_graph import Target, convert
from labweb.workflows.management.commands.compile_transfers import read_graph
from labweb.workflows.management.file_command import FileCommand


class Command(FileCommand):
    """`manage.py convert_graph`."""

    help = (
        "Write IN as OUT in another format. What the format cannot hold is a finding, and then "
        "nothing is written unless --lossy is given. Exit code: 0 written, 2 refused or written "
        "with losses, 1 a file cannot be read or written, or OUT is there already."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        about = "JSON or GraphML of a Chemputer or Uni-Lab-OS, or a lab.json, packed or not"
        parser.add_argument("source", metavar="IN", type=Path, help=about)
        parser.add_argument("target", metavar="OUT", type=Path, help="file to write")
        parser.add_argument(
            "--to",
            required=True,
            metavar="FORMAT",
            choices=[one.value for one in Target],
            help=", ".join(one.value for one in Target),
        )
        parser.add_argument("--name", help="what the lab is called; else as the file is")
        parser.add_argument(
            "--lossy", action="store_true", help="write OUT although something is lost"
        )
        parser.add_argument("--json", action="store_true", help="print findings as JSON")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Convert, or say why not.

        Raises:
            CommandError: Exit code 1: a file cannot be read or written. Exit code 2: the graph
                is refused, or something of it is lost; without `--lossy` nothing was written.
        """
        source, target = options["source"], options["target"]
        if target.exists():
            raise CommandError(f"{target} is there already")
        try:
            raw = read_graph(source)
            found = convert(raw, Target(options["to"]), options["name"] or source.stem)
        except OSError as error:
            raise CommandError(f"cannot read {source}: {error.strerror}") from error
        except LabError as error:
            findings = error.findings or (Finding(error.code, error.message),)
            self._print(findings, as_json=options["json"])
            raise CommandError(f"{error.code}: {error.message}", returncode=2) from error
        if not found.findings or options["lossy"]:
            _write(target, found.raw)
        self._print(found.findings, as_json=options["json"])
        if found.findings:
            count = len(found.findings)
            what = f"{target} is written" if options["lossy"] else "nothing is written"
            message = f"{count} entries are not held in full: {what}"
            raise CommandError(message, returncode=2)
        if not options["json"]:
            self.stdout.write(f"{target}: {options['to']}")

    def _print(self, findings: Sequence[Finding], *, as_json: bool) -> None:
        if as_json:
            plain = {"ok": not findings, "findings": [finding.to_json() for finding in findings]}
            self.stdout.write(json.dumps(plain, ensure_ascii=False))
            return
        for finding in findings:
            self.stderr.write(f"{finding.subject or '-'}  {finding.code}  {finding.message}")


def _write(target: Path, raw: bytes) -> None:
    try:
        with target.open("xb") as file:
            file.write(raw)
    except OSError as error:
        raise CommandError(f"cannot write {target}: {error.strerror}") from error
