"""Turn untrusted bytes into plain data, within bounds, or say exactly what is wrong."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

from labweb.domain.errors import Finding, LabFileError

MAX_BYTES = 32 * 1024 * 1024
"""Largest lab file that is read."""

MAX_NODES = 100_000
"""Most nodes, links or other entries in one list of a lab file."""

MAX_DEPTH = 64
"""Deepest nesting of a lab file; the outermost value is at depth 1."""

MAX_FOREIGN_DEPTH = MAX_DEPTH - 8
"""Deepest nesting of a foreign file: its nodes lie deeper in a lab file that carries them."""

MAX_FOREIGN_TEXT = 200
"""Longest id, port or liquid of a foreign file: keys of ours are made of two of them."""

MAX_TEXT = 500
"""Longest key and name."""

_LARGEST_INTEGER = 2**63 - 1


def refuse(code: str, message: str, subject: str = "") -> LabFileError:
    """Build the error of a file that has one finding."""
    return LabFileError(message, code=code, findings=[Finding(code, message, subject)])


def refuse_all(findings: list[Finding], what: str) -> LabFileError:
    """Build the error of a file that has several findings; none of the file is used."""
    count = len(findings)
    first = findings[0].message
    more = f" (and {count - 1} more)" if count > 1 else ""
    return LabFileError(f"{what} is refused: {first}{more}", findings=findings)


def decode_json(raw: bytes, max_depth: int = MAX_DEPTH) -> object:
    """Decode a JSON document strictly.

    Args:
        raw: The document.
        max_depth: A foreign file gets less, because it is carried inside our own.

    Raises:
        LabFileError: With one of the codes `lab_file.too_large`, `lab_file.encoding`,
            `lab_file.json`, `lab_file.duplicate_key`, `lab_file.number`,
            `lab_file.depth`, `lab_file.text`.
    """
    if len(raw) > MAX_BYTES:
        raise refuse(
            "lab_file.too_large", f"the file has {len(raw)} bytes; at most {MAX_BYTES} are read"
        )
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refuse(
            "lab_file.encoding", f"the file is not UTF-8: byte {error.start} cannot be read"
        ) from error
    try:
        value: object = json.loads(
            text,
            object_pairs_hook=_unique,
            parse_constant=_refuse_constant,
            parse_float=_finite,
            parse_int=_bounded,
        )
    except json.JSONDecodeError as error:
        raise refuse(
            "lab_file.json",
            f"the file is not JSON: {error.msg} at line {error.lineno}, column {error.colno}",
        ) from error
    except RecursionError as error:
        raise _too_deep(max_depth) from error
    # Raw text holds neither NULs nor halves of pairs: only escapes bring them in.
    _check_values(value, max_depth, may_hide_text="\\u" in text)
    return value


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in pairs:
        if key in found:
            raise refuse(
                "lab_file.duplicate_key",
                f"the key {key!r} stands twice in one object; which one counts is unknown",
                key,
            )
        found[key] = value
    return found


def _refuse_constant(text: str) -> object:
    raise refuse("lab_file.number", f"{text} is not a number that JSON knows")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise refuse("lab_file.number", f"{text[:32]} is beyond any number that can be stored")
    return value


def _bounded(text: str) -> int:
    # 19 digits hold 2**63 - 1; longer texts are not even converted.
    if len(text.lstrip("-")) > len(str(_LARGEST_INTEGER)) or abs(int(text)) > _LARGEST_INTEGER:
        raise refuse("lab_file.number", f"{text[:32]} is beyond 64 bits")
    return int(text)


def _too_deep(max_depth: int) -> LabFileError:
    return refuse("lab_file.depth", f"the file is nested deeper than {max_depth} levels")


def _check_values(value: object, max_depth: int, *, may_hide_text: bool) -> None:
    level, depth = [value], 0
    while level:
        boxes = [part for part in level if isinstance(part, dict | list)]
        depth += bool(boxes)
        if depth > max_depth:
            raise _too_deep(max_depth)
        if may_hide_text:
            for text in _texts(level):
                _check_text(text)
        level = [part for box in boxes for part in (box.values() if isinstance(box, dict) else box)]


def _texts(values: list[object]) -> Iterator[str]:
    """Yield the texts among the values, and the keys of the objects among them."""
    for value in values:
        if isinstance(value, str):
            yield value
        elif isinstance(value, dict):
            yield from value


def _check_text(text: str) -> None:
    if text.isascii() and "\0" not in text:
        return
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise refuse("lab_file.text", f"{text[:40]!r} has half of a surrogate pair") from error
    if "\0" in text:
        raise refuse("lab_file.text", f"{text[:40]!r} has a NUL character")
