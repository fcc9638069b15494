"""Bring a lab file into the database, or say what is wrong with it."""

from __future__ import annotations

import hashlib
import json
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from django.core.management.base import BaseCommand, CommandError

from labweb.common.database.bulk import without_collector
from labweb.crutd.services import check_time_zone, import_lab
from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.lab_file.binding_file import read_binding
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.uni_lab_os.import_report import report
from labweb.domain.recipes.graph_formats.lab_of_any_format import Format, LabDocument

BINDINGS = Path(__file__).parents[4] / "fixtures" / "bindings"


class Command(BaseCommand):
    """`manage.py import_lab`."""

    help = (
        "Import a lab file of labweb, Uni-Lab-OS or a Chemputer. A file that is refused changes "
        "nothing."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        what = parser.add_mutually_exclusive_group(required=True)
        what.add_argument("file", type=Path, nargs="?", help="lab file")
        what.add_argument(
            "--report", type=Path, help="only say what each graph of a folder becomes"
        )
        parser.add_argument("--check", action="store_true", help="read and judge; write nothing")
        parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
        parser.add_argument("--bind", type=Path, help="binding of foreign classes to drivers")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Import, check or report.

        Raises:
            CommandError: The file is refused (exit code 1). Nothing was written.
        """
        if options["report"] is not None:
            self._report(options["report"], is_json=options["json"])
            return
        path: Path = options["file"]
        answer: dict[str, Any] = {"file": path.name, "verdict": "refused", "findings": []}
        try:
            with without_collector():
                self._bring(path, options, answer)
        except OSError as error:
            raise CommandError(f"cannot read the file: {error}") from error
        except LabError as error:
            findings = error.findings or (Finding(error.code, error.message),)
            self._say({**answer, "findings": _plain(findings)}, is_json=options["json"])
            raise CommandError(f"{error.code}: {error.message}", returncode=1) from error
        answer["verdict"] = "checked" if options["check"] else "imported"
        self._say(answer, is_json=options["json"])

    def _bring(self, path: Path, options: dict[str, Any], answer: dict[str, Any]) -> None:
        raw = path.read_bytes()
        document = LabDocument(raw, path.stem)
        answer["format"] = document.format.value
        lab_file = self._read(document, options["bind"])
        answer |= _counted(lab_file)
        check_time_zone(lab_file)
        if not options["check"]:
            source = {"file": path.name, "format": answer["format"]}
            source["sha256"] = hashlib.sha256(raw).hexdigest()
            import_lab(lab_file, actor=None, source=source)

    def _read(self, document: LabDocument, bind: Path | None) -> LabFile:
        if bind is None and document.format is Format.LABWEB:
            return document.read()
        path = bind or BINDINGS / f"{document.format}.json"
        return document.bound(read_binding(path.read_bytes()))[0]

    def _report(self, folder: Path, *, is_json: bool) -> None:
        if not folder.is_dir():
            raise CommandError(f"{folder} is no folder")
        paths = sorted(folder.rglob("*.json"))
        rows = report({str(path.relative_to(folder)): path.read_bytes() for path in paths})
        if is_json:
            self.stdout.write(json.dumps(msgspec.to_builtins(rows), ensure_ascii=False, indent=2))
            return
        lines = [
            (row.verdict, row.nodes, row.links, row.foreign, row.file, _codes(row.findings))
            for row in rows
        ]
        self._table(("verdict", "nodes", "links", "foreign", "file", "findings"), lines)

    def _say(self, answer: dict[str, Any], *, is_json: bool) -> None:
        if is_json:
            self.stdout.write(json.dumps(answer, ensure_ascii=False, indent=2))
            return
        told = ", ".join(f"{count} {name}" for name, count in answer.get("counts", {}).items())
        self.stdout.write(f"{answer['file']}: {answer['verdict']}" + (f" ({told})" if told else ""))
        for sort in ("findings", "notes"):
            entries = answer.get(sort, [])
            if entries:
                self._table(
                    (sort, "about", "message"),
                    [(entry["code"], entry["subject"], entry["message"]) for entry in entries],
                )

    def _table(self, heads: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        cells = [[str(cell) for cell in row] for row in (heads, *rows)]
        widths = [max(len(row[column]) for row in cells) for column in range(len(heads))]
        for row in cells:
            padded = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            self.stdout.write("  ".join(padded).rstrip())


def _counted(lab_file: LabFile) -> dict[str, Any]:
    """Say what a lab file brings."""
    counts = {
        "resources": len(lab_file.resources),
        "connections": len(lab_file.connections),
        "devices": len(lab_file.devices),
        "materials": len(lab_file.materials),
        "lots": len(lab_file.lots),
    }
    kinds = Counter(resource.kind for resource in lab_file.resources)
    return {
        "lab": {"id": str(lab_file.id), "name": lab_file.name, "mode": lab_file.mode.value},
        "counts": counts,
        "kinds": dict(sorted(kinds.items())),
        "notes": _plain(lab_file.notes),
    }


def _plain(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    return [finding.to_json() for finding in findings]


def _codes(findings: Sequence[Finding]) -> str:
    return ", ".join(dict.fromkeys(finding.code for finding in findings))
