"""Compile transfers against a physical graph in a file. No database is asked."""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from django.core.management.base import CommandError

from labweb.domain.errors import Finding, LabFileError
from labweb.domain.graph.lab_file.untrusted_json import MAX_BYTES
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.rig_read import read_rig, unpacked
from labweb.domain.recipes.transfers_on_rig import MOST_LINE_BYTES, compile_line
from labweb.workflows.management.file_command import FileCommand

REFUSED = 2
"""Exit code when at least one line was refused."""


class Command(FileCommand):
    """`manage.py compile_transfers`."""

    help = (
        "Compile each line of REQUESTS, a JSON object {from, to, volume}, against GRAPH, and write "
        "one JSON line for each, in order. Exit code: 0 all compiled, 2 some refused, 1 GRAPH or "
        "REQUESTS cannot be read."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument(
            "graph", type=Path, help="JSON or GraphML of a Chemputer or Uni-Lab-OS, or a lab.json"
        )
        parser.add_argument("requests", help="file with one request on each line, or - for stdin")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Compile every line.

        Raises:
            CommandError: A file cannot be read (exit code 1), or the graph is refused, in which
                case every line is still answered with the first findings about the graph, and
                all of them are told once.
            SystemExit: Code 2, when at least one line was refused.
        """
        rig: Rig | list[Finding]
        problem = ""
        try:
            rig = read_rig(read_graph(options["graph"]))
        except OSError as error:
            raise CommandError(f"cannot read {options['graph']}: {error.strerror}") from error
        except LabFileError as error:
            problem = f"{error.code}: {error.message}"
            rig = list(error.findings) or [Finding(error.code, error.message)]
            for one in rig:
                self.stderr.write(f"{one.subject or '-'}  {one.code}  {one.message}")
        is_refused = self._answer(rig, options["requests"])
        if problem:
            raise CommandError(problem)
        if is_refused:
            sys.exit(REFUSED)

    def _answer(self, rig: Rig | list[Finding], requests: str) -> bool:
        """Write an answer to each line; tell whether one was refused."""
        is_refused = False
        try:
            for line in _read_lines(requests):
                answer = compile_line(rig, line)
                is_refused |= not answer["ok"]
                self.stdout.write(json.dumps(answer, separators=(",", ":")))
            self.stdout.flush()
        except OSError as error:
            raise CommandError(f"cannot write the answers: {error.strerror}") from error
        return is_refused


def read_graph(path: Path) -> bytes:
    """Read a graph, unpacked when it is packed; one byte too many shows that it is too large."""
    with path.open("rb") as stream:
        return unpacked(stream.read(MAX_BYTES + 1))


@contextmanager
def _open(name: str) -> Iterator[BinaryIO]:
    if name == "-":
        yield sys.stdin.buffer
    else:
        with Path(name).open("rb") as stream:
            yield stream


def _read_lines(name: str) -> Iterator[bytes]:
    try:
        with _open(name) as stream:
            yield from _lines(stream)
    except OSError as error:
        raise CommandError(f"cannot read {name}: {error.strerror}") from error


def _lines(stream: BinaryIO) -> Iterator[bytes]:
    """Yield each line; of one that is too long, just enough to see that it is."""
    while line := stream.readline(MOST_LINE_BYTES + 2):
        whole = line
        while not whole.endswith(b"\n") and (whole := stream.readline(MOST_LINE_BYTES)):
            pass
        yield line.rstrip(b"\r\n")
