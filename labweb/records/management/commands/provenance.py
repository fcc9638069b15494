"""Tell what led to a thing and what it touched, or judge a PROV document."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any
from uuid import UUID

from django.core.management.base import BaseCommand, CommandError

from labweb.crutd.selectors.lineage import DEEPEST
from labweb.domain.crutd.provenance.graph_views import HEADS, to_dot, to_json, to_rows
from labweb.domain.crutd.provenance.prov_check import check_prov
from labweb.domain.crutd.provenance.prov_json_read import read_prov
from labweb.domain.crutd.provenance.prov_json_write import render_prov
from labweb.domain.errors import Finding, LabError
from labweb.records.selectors import provenance
from labweb.records.selectors.provenance import Provenance
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs import selectors as run_selectors
from labweb.telemetry import selectors as telemetry_selectors

FORMATS = ("table", "json", "prov", "dot")

_Ask = Callable[..., Provenance]


class Command(BaseCommand):
    """`manage.py provenance`."""

    help = "Tell what led to a resource, lot, run, file or reading, and what it touched."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        what = parser.add_mutually_exclusive_group(required=True)
        what.add_argument(
            "subject",
            nargs="?",
            help="id, or key of a resource or lot, or #number of a run, or checksum of a file; "
            "resource:, lot:, run:, file: or reading: before it says which",
        )
        what.add_argument("--check", type=Path, help="judge a PROV-JSON document")
        parser.add_argument("--direction", choices=provenance.DIRECTIONS, default="both")
        parser.add_argument("--depth", type=int, default=10, help=f"transfers, 1 to {DEEPEST}")
        parser.add_argument("--format", choices=FORMATS, default="table")
        parser.add_argument("--lab", help="key of the lab, when there are several")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Print the answer, or say why there is none.

        Raises:
            CommandError: There is no such thing, or the document is malformed or contradicts
                itself (exit code 1).
        """
        if options["check"] is not None:
            self._check(options["check"])
            return
        if not 1 <= options["depth"] <= DEEPEST:
            raise CommandError(f"depth must be 1 to {DEEPEST}")
        try:
            ask = _named(_lab(options["lab"]), options["subject"])
            found = ask(direction=options["direction"], depth=options["depth"])
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error
        self._say(found, options["format"])

    def _check(self, path: Path) -> None:
        try:
            findings = check_prov(read_prov(path.read_bytes()))
        except OSError as error:
            raise CommandError(f"cannot read the file: {error}") from error
        except LabError as error:
            self._findings(error.findings)
            raise CommandError(f"{error.code}: {error.message}") from error
        if findings:
            self._findings(findings)
            raise CommandError(f"prov.conflict: {path.name} contradicts itself")
        self.stdout.write(f"{path.name}: valid")

    def _findings(self, findings: Iterable[Finding]) -> None:
        self._table(
            [("finding", "at", "message"), *((f.code, f.subject, f.message) for f in findings)]
        )

    def _say(self, found: Provenance, form: str) -> None:
        told = found.truncation()
        if form == "dot":
            self.stdout.write(to_dot(found.graph), ending="")
        elif form == "prov":
            self._json(render_prov(found.graph, str(found.lab.id)))
        elif form == "json":
            self._json({**to_json(found.graph), "truncation": told})
        else:
            self._table([HEADS, *to_rows(found.graph)])
        if told["is_truncated"]:
            vessels = f", {len(told['unread'])} vessels with too long a history"
            self.stderr.write(
                f"This is not all: {told['beyond']} transfers beyond"
                + (vessels if told["unread"] else "")
                + (", more acts than one answer holds" if told["has_more_acts"] else "")
            )

    def _json(self, value: object) -> None:
        self.stdout.write(json.dumps(value, ensure_ascii=False, indent=2))

    def _table(self, rows: Sequence[Sequence[str]]) -> None:
        widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
        for row in rows:
            cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            self.stdout.write("  ".join(cells).rstrip())


def _lab(key: str | None) -> Lab:
    if key is None:
        return resource_selectors.the_lab()
    found = resource_selectors.labs().filter(key=key).first()
    if found is None:
        raise CommandError(f"no lab has the key {key!r}")
    return found


def _named(lab: Lab, text: str) -> _Ask:
    """Return what to ask for the one thing that a text names.

    Raises:
        CommandError: It names nothing, or several things.
    """
    sort, colon, rest = text.partition(":")
    known = {
        "resource": _resources, "lot": _lots, "run": _runs, "file": _files, "reading": _readings,
    }  # fmt: skip
    finders = {sort: known[sort]} if colon and sort in known else known
    name = rest if colon and sort in known else text
    found = {kind: ask for kind, find in finders.items() for ask in find(lab, name)}
    if not found:
        raise CommandError(f"no resource, lot, run, file or reading is named {text!r}")
    if len(found) > 1:
        choices = " or ".join(f"{kind}:{name}" for kind in found)
        raise CommandError(f"{text!r} names several things: say {choices}")
    return next(iter(found.values()))


def _id(text: str) -> UUID | None:
    try:
        return UUID(text)
    except ValueError:
        return None


def _resources(lab: Lab, name: str) -> list[_Ask]:
    key = {"key": name} if _id(name) is None else {"pk": name}
    rows = resource_selectors.resources_of(lab).filter(**key).select_related("lab")
    return [lambda row=row, **more: provenance.of_resource(row, **more) for row in rows[:1]]


def _lots(lab: Lab, name: str) -> list[_Ask]:
    key = {"key": name} if _id(name) is None else {"pk": name}
    rows = resource_selectors.lots_of(lab).filter(**key).select_related("lab")
    return [lambda row=row, **more: provenance.of_lot(row, **more) for row in rows[:1]]


def _runs(lab: Lab, name: str) -> list[_Ask]:
    number = name.removeprefix("#")
    if _id(name) is not None:
        rows = run_selectors.runs_of(lab).filter(pk=name)
    elif number.isascii() and number.isdigit() and len(number) < 10:
        rows = run_selectors.runs_of(lab).filter(number=int(number))
    else:
        return []
    return [lambda row=row, **more: provenance.of_run(row, **more) for row in rows[:1]]


def _files(lab: Lab, name: str) -> list[_Ask]:
    key = {"sha256": name} if _id(name) is None else {"pk": name}
    rows = telemetry_selectors.files_of(lab).filter(**key)[:2]
    if len(rows) > 1:
        raise CommandError("the same bytes were kept for several subjects: ask by the id of one")
    return [lambda row=row, **more: provenance.of_file(row, **more) for row in rows]


def _readings(lab: Lab, name: str) -> list[_Ask]:
    if _id(name) is None:
        return []
    rows = telemetry_selectors.readings_of(lab).filter(pk=name)
    return [lambda row=row, **more: provenance.of_reading(row, **more) for row in rows[:1]]
