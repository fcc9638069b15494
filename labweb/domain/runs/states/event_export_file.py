"""The file that carries a lab's events elsewhere: JSON lines, each bound to the last.

```text
{"n": 1, "kind": "head", "body": {"format": "labweb events", "version": 1}, "hash": …}
{"n": 2, "kind": …, "body": …, "hash": …}
{"n": 3, "kind": "end", "body": {"lines": 2}, "hash": …}
```

`hash` is the SHA-256 of the hash before it and the line without its own, so that the first line
that was edited, exchanged, left out or put in is found, and a lost end too.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.errors import DefinitionError

FORMAT, VERSION = "labweb events", 1
_HEAD = {"format": FORMAT, "version": VERSION}


class ExportLine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One line of the file."""

    n: int
    """Place in the file, from 1."""

    kind: str
    body: Any
    hash: str


def bad_line(n: int, why: str) -> DefinitionError:
    """Return the error that names the first line that does not hold."""
    return DefinitionError(f"line {n} {why}", code="event_file.line", context={"line": n})


def _hash_of(prev: str, n: int, kind: str, body: object) -> str:
    fields = {"prev": prev, "n": n, "kind": kind, "body": body}
    return hashlib.sha256(canonical(fields)).hexdigest()


def write(records: Iterable[tuple[str, Any]]) -> Iterator[bytes]:
    """Yield the lines of a file that carries these records, each with its kind."""
    prev, n = "", 0

    def sealed(kind: str, body: object) -> bytes:
        nonlocal prev, n
        n += 1
        prev = _hash_of(prev, n, kind, body)
        return msgspec.json.encode(ExportLine(n=n, kind=kind, body=body, hash=prev)) + b"\n"

    yield sealed("head", _HEAD)
    for kind, body in records:
        yield sealed(kind, body)
    yield sealed("end", {"lines": n})


def read(raw: Iterable[bytes]) -> Iterator[ExportLine]:
    """Yield the records of a file, head and end left out, a line at a time.

    Raises:
        DefinitionError: `event_file.line`: a line cannot be read, was edited, exchanged or left
            out, or the end is missing. What came before it was whole.
    """
    prev, n = "", 0
    has_ended = False
    for n, text in enumerate(raw, start=1):
        if has_ended:
            raise bad_line(n, "follows the end")
        line = _line(n, text)
        if line.hash != _hash_of(prev, n, line.kind, line.body):
            raise bad_line(n, "was edited, or does not follow the one before it")
        prev, has_ended = line.hash, line.kind == "end"
        if n == 1 and line.body != _HEAD:
            raise bad_line(n, f"is not the head of a file of {FORMAT}, version {VERSION}")
        if n > 1 and not has_ended:
            yield line
    if not has_ended:
        raise bad_line(n + 1, "is missing: the end was cut off")


def _line(n: int, text: bytes) -> ExportLine:
    try:
        line = msgspec.json.decode(text, type=ExportLine)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise bad_line(n, f"cannot be read: {error}") from error
    if line.n != n:
        raise bad_line(n, f"says that it is line {line.n}: lines are missing or were exchanged")
    return line
