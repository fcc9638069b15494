"""Bring a piece of labware into a lab, or say what is wrong with its definition."""

from __future__ import annotations

import hashlib
import json
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.db.transaction import atomic, set_rollback

from labweb.crutd.services import import_labware
from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.lab_file.lab_model import entry_id
from labweb.domain.graph.lab_file.untrusted_json import decode_json
from labweb.domain.resources.labware.labware_formats import LabwareFile, read_labware, resources_of
from labweb.domain.resources.labware.labware_resources import LabwareIdentity
from labweb.domain.resources.placement import check_places
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_tree import Tree
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


class Command(BaseCommand):
    """`manage.py import_labware`."""

    help = (
        "Import a labware definition or a deck of Opentrons, or a resource of PyLabRobot. "
        "A file that is refused changes nothing."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("file", type=Path, help="definition, as JSON")
        parser.add_argument("--into", required=True, help="key of what it stands in")
        parser.add_argument("--key", help="key of the labware; else its name")
        parser.add_argument("--name", required=True, help="what a person calls it")
        parser.add_argument("--lab", help="key of the lab, when there are several")
        parser.add_argument(
            "--full", action="store_true", help="every tip rack in it is full: bring its tips"
        )
        parser.add_argument("--check", action="store_true", help="read and judge; write nothing")
        parser.add_argument("--json", action="store_true", help="print JSON instead of text")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Import or check.

        Raises:
            CommandError: The file or the place is refused (exit code 1). Nothing was written.
        """
        path: Path = options["file"]
        answer: dict[str, Any] = {"file": path.name, "verdict": "refused", "findings": []}
        try:
            raw = path.read_bytes()
            file = read_labware(decode_json(raw))
            answer |= {"format": file.format, "notes": _plain(file.notes)}
            source = {"file": path.name, "format": file.format}
            source["sha256"] = hashlib.sha256(raw).hexdigest()
            answer |= self._write(file, source, options)
        except OSError as error:
            raise CommandError(f"cannot read the file: {error}") from error
        except LabError as error:
            findings = error.findings or (Finding(error.code, error.message),)
            self._say({**answer, "findings": _plain(findings)}, is_json=options["json"])
            raise CommandError(f"{error.code}: {error.message}", returncode=1) from error
        answer["verdict"] = "checked" if options["check"] else "imported"
        self._say(answer, is_json=options["json"])

    def _write(
        self, file: LabwareFile, source: dict[str, str], options: dict[str, Any]
    ) -> dict[str, Any]:
        """Write the labware, or try to and take it back when it is only checked."""
        lab = _lab(options["lab"])
        parent = resource_selectors.find_by_key(lab, options["into"])
        key = options["key"] or options["name"]
        id_of = partial(entry_id, lab.id, "resource")
        identity = LabwareIdentity(
            id=id_of(key), key=key, name=options["name"], parent_id=parent.id
        )
        resources = resources_of(file, identity, id_of, is_full=options["full"])
        with atomic():
            import_labware(resources, lab=lab, actor=None, source=source)
            set_rollback(options["check"])
        notes = [*file.notes, *check_places(Tree(tuple(resources)))]
        return {**_counted(resources), "notes": _plain(notes)}

    def _say(self, answer: dict[str, Any], *, is_json: bool) -> None:
        if is_json:
            self.stdout.write(json.dumps(answer, ensure_ascii=False, indent=2))
            return
        told = ", ".join(f"{count} {kind}" for kind, count in answer.get("kinds", {}).items())
        self.stdout.write(f"{answer['file']}: {answer['verdict']}" + (f" ({told})" if told else ""))
        for entry in (*answer["findings"], *answer.get("notes", [])):
            self.stdout.write(f"{entry['code']}  {entry['message']}")


def _lab(key: str | None) -> Lab:
    if key is None:
        return resource_selectors.the_lab()
    found = resource_selectors.labs().filter(key=key).first()
    if found is None:
        raise CommandError(f"no lab has the key {key!r}")
    return found


def _counted(resources: Sequence[Resource]) -> dict[str, Any]:
    """Say what an import brings."""
    kinds = Counter(resource.kind for resource in resources)
    first = resources[0]
    return {
        "resource": {"id": str(first.id), "key": first.key, "name": first.name},
        "kinds": dict(sorted(kinds.items())),
    }


def _plain(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    return [finding.to_json() for finding in findings]
