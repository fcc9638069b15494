"""Execute a compiled plan on paper, and say whether all that it claims is proved."""

from __future__ import annotations

import hashlib
import json
import sys
from argparse import ArgumentParser
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from django.core.management.base import CommandError

from labweb.domain.errors import Finding, LabError, LabFileError, ProtocolError
from labweb.domain.graph.lab_file.untrusted_json import MAX_BYTES
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.proof.execute_plan import check_plan
from labweb.domain.proof.plan_read import parse_plan
from labweb.domain.proof.plumbing import Plumbing
from labweb.domain.proof.transfer_judge import check_answer
from labweb.workflows.management.commands.compile_transfers import read_graph
from labweb.workflows.management.file_command import FileCommand

NOT_PROVED = 2
"""Exit code when there is a finding."""


class Command(FileCommand):
    """`manage.py interpret`."""

    help = (
        "Execute PLAN symbolically on GRAPH and compare what came of it with what each step "
        "claims. Exit code: 0 proved, 2 not proved, 1 a file cannot be read. Needs no database."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument(
            "graph", type=Path, help="JSON or GraphML of a Chemputer or Uni-Lab-OS, or a lab.json"
        )
        parser.add_argument(
            "plan", type=Path, help="plan of compile_protocol, or answers of compile_transfers"
        )
        parser.add_argument(
            "--request", type=Path, help="requests that the lines of PLAN are the answers to"
        )
        parser.add_argument("--json", action="store_true", help="print findings as JSON")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Execute the plan, or each answer.

        Raises:
            CommandError: A file cannot be read (exit code 1).
            SystemExit: Code 2, when something is not proved.
        """
        try:
            findings = self._findings(options)
        except LabFileError as error:
            found = error.findings or (Finding(error.code, error.message),)
            self._print(list(found), as_json=options["json"])
            raise CommandError(f"{error.code}: {error.message}") from error
        self._print(findings, as_json=options["json"])
        if findings:
            sys.exit(NOT_PROVED)

    def _findings(self, options: dict[str, Any]) -> list[Finding]:
        graph = _read_graph(options["graph"])
        rig, raw = read_rig(graph), _read(options["plan"])
        if options["request"] is not None:
            return list(_check_lines(rig, _read(options["request"]), raw))
        try:
            plan = parse_plan(raw)
        except ProtocolError as error:
            return list(error.findings)
        return check_plan(rig, plan, hashlib.sha256(graph).hexdigest())

    def _print(self, findings: list[Finding], *, as_json: bool) -> None:
        if as_json:
            plain = {"ok": not findings, "findings": [one.to_json() for one in findings]}
            self.stdout.write(json.dumps(plain, ensure_ascii=False))
            return
        for finding in findings:
            self.stderr.write(f"{finding.subject or '-'}  {finding.code}  {finding.message}")
        self.stdout.write(f"not proved: {len(findings)} findings" if findings else "proved")


def _read(path: Path) -> bytes:
    """Read a file; one byte too many shows that it is too large."""
    try:
        with path.open("rb") as stream:
            return stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise CommandError(f"cannot read {path}: {error.strerror}") from error


def _read_graph(path: Path) -> bytes:
    try:
        return read_graph(path)
    except OSError as error:
        raise CommandError(f"cannot read {path}: {error.strerror}") from error


def _check_lines(rig: Rig, requests: bytes, answers: bytes) -> Iterator[Finding]:
    if max(len(requests), len(answers)) > MAX_BYTES:
        message = f"a file has more than {MAX_BYTES} bytes"
        raise LabFileError(message, findings=[Finding("lab_file.too_large", message)])
    plumbing = Plumbing(rig)
    asked, answered = requests.splitlines(), answers.splitlines()
    if len(asked) != len(answered):
        message = f"{len(asked)} requests have {len(answered)} answers"
        yield Finding("interpret.shape", message)
    for number, (request, answer) in enumerate(zip(asked, answered, strict=False), start=1):
        try:
            found = check_answer(plumbing, request, answer)
        except LabError as error:
            found = [Finding(error.code, error.message)]
        for finding in found:
            subject = f"line {number}"
            yield Finding(finding.code, f"{subject}: {finding.message}", subject, finding.context)
