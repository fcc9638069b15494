"""Take deliveries in from a CSV file, or say what is wrong with it."""

from __future__ import annotations

import hashlib
import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.db.transaction import atomic, set_rollback

from labweb.accounts import selectors as account_selectors
from labweb.crutd.services import receive_deliveries
from labweb.domain.crutd.delivery_table import COLUMNS, REQUIRED, parse_deliveries
from labweb.domain.errors import Finding, LabError
from labweb.resources import selectors as resource_selectors


class Command(BaseCommand):
    """`manage.py import_lots`."""

    help = (
        f"Receive lots from a CSV file with the columns {', '.join(COLUMNS)}; "
        f"{', '.join(REQUIRED)} are needed. A file that is refused changes nothing."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("file", type=Path, help="the table")
        parser.add_argument("--by", required=True, help="name of who received the lots")
        parser.add_argument("--check", action="store_true", help="read and judge; write nothing")
        parser.add_argument("--json", action="store_true", help="print JSON instead of text")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Receive or check.

        Raises:
            CommandError: The file is refused (exit code 1). Nothing was written.
        """
        path: Path = options["file"]
        answer: dict[str, Any] = {"file": path.name, "verdict": "refused", "findings": []}
        actor = account_selectors.find_user(options["by"])
        if actor is None:
            raise CommandError(f"there is no user {options['by']!r}")
        try:
            raw = path.read_bytes()
            deliveries = parse_deliveries(raw)
            source = {"file": path.name, "sha256": hashlib.sha256(raw).hexdigest()}
            lab = resource_selectors.the_lab()
            with atomic():
                lots = receive_deliveries(deliveries, lab=lab, actor=actor, source=source)
                set_rollback(options["check"])
        except OSError as error:
            raise CommandError(f"cannot read the file: {error}") from error
        except LabError as error:
            findings = error.findings or (Finding(error.code, error.message),)
            answer["findings"] = [finding.to_json() for finding in findings]
            self._say(answer, is_json=options["json"])
            raise CommandError(f"{error.code}: {error.message}", returncode=1) from error
        answer["verdict"] = "checked" if options["check"] else "received"
        pairs = zip(lots, deliveries, strict=True)
        answer["lots"] = [{"id": str(lot), "key": one.lot} for lot, one in pairs]
        self._say(answer, is_json=options["json"])

    def _say(self, answer: dict[str, Any], *, is_json: bool) -> None:
        if is_json:
            self.stdout.write(json.dumps(answer, ensure_ascii=False, indent=2))
            return
        told = f" ({len(answer['lots'])} lots)" if "lots" in answer else ""
        self.stdout.write(f"{answer['file']}: {answer['verdict']}{told}")
        for entry in answer["findings"]:
            self.stdout.write(f"{entry['subject']}  {entry['code']}  {entry['message']}")
