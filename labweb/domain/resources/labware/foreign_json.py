"""Read foreign JSON value by value; whatever is wrong becomes a finding, none is guessed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.errors import DefinitionError, Finding
from labweb.domain.resources.exact_volumes import to_nl
from labweb.domain.resources.labware.labware_definition import Vector

MAX_FINDINGS = 100
"""So many findings are told of one file; more of them help nobody."""

LONGEST_TEXT = 200
"""Longest name, label or address."""

FARTHEST_MM = 100_000.0
"""Largest length and coordinate."""

_UL = 1000
_PRINTABLE = re.compile(r"[^\x00-\x1f\x7f]+")


@dataclass(frozen=True)
class JsonReader:
    """One object of a file, and where it stands in it."""

    value: Mapping[str, Any]
    path: str
    findings: list[Finding] = field(default_factory=list)

    def refuse(self, code: str, message: str, key: str = "") -> None:
        """Note a finding about this object or one of its fields."""
        where = f"{self.path}.{key}" if key and self.path else key or self.path
        if len(self.findings) < MAX_FINDINGS:
            self.findings.append(Finding(code, f"{where or 'the file'}: {message}", where))

    def has(self, key: str) -> bool:
        """Tell whether the field is there and not null."""
        return self.value.get(key) is not None

    def _get(self, key: str, kind: type | tuple[type, ...], what: str) -> Any:  # noqa: ANN401 - JSON
        if not self.has(key):
            self.refuse("labware.missing", "is missing", key)
            return None
        found = self.value[key]
        if not isinstance(found, kind) or (isinstance(found, bool) and kind is not bool):
            self.refuse("labware.field", f"is no {what}", key)
            return None
        return found

    def number(self, key: str, low: float = 0.0, high: float = FARTHEST_MM) -> float:
        """Return a finite number within bounds, or zero and a finding."""
        found = self._get(key, (int, float), "number")
        if found is None:
            return 0.0
        try:
            number = float(found)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number) or not low <= number <= high:
            self.refuse("labware.number", f"is not between {low:g} and {high:g}", key)
            return 0.0
        return number

    def optional_number(self, key: str, low: float = 0.0) -> float | None:
        """Return a number, or None where nothing is said."""
        return self.number(key, low) if self.has(key) else None

    def count(self, key: str, default: int | None = None) -> int:
        """Return a whole number of at least one."""
        if default is not None and not self.has(key):
            return default
        found = self._get(key, int, "whole number")
        if found is None:
            return 1
        if not 1 <= found <= 10_000:
            self.refuse("labware.number", "is not between 1 and 10000", key)
            return 1
        return int(found)

    def capacity_nl(self, key: str) -> int | None:
        """Return a volume in whole nanolitres that the file gives in microlitres."""
        found = self.number(key, high=1e12)
        amount = to_nl(found, _UL)
        if amount is None:
            self.refuse("labware.amount", f"{found} µL is no whole number of nanolitres", key)
        return amount

    def text(self, key: str) -> str:
        """Return a name: not empty, not too long, without control characters."""
        found = self._get(key, str, "text")
        if found is None:
            return ""
        if not self.is_name(found):
            self.refuse("labware.text", f"is no text of 1 to {LONGEST_TEXT} characters", key)
            return ""
        return str(found)

    @staticmethod
    def is_name(text: object) -> bool:
        """Tell whether something can be a name."""
        return (
            isinstance(text, str)
            and len(text) <= LONGEST_TEXT
            and _PRINTABLE.fullmatch(text) is not None
            and text.strip() != ""
            and not any("\ud800" <= letter <= "\udfff" for letter in text)
        )

    def flag(self, key: str) -> bool:
        """Return a yes or no."""
        return bool(self._get(key, bool, "true or false"))

    def choice(self, key: str, options: Sequence[str]) -> str:
        """Return one of a few words."""
        found = self._get(key, str, "text")
        if found is not None and found not in options:
            self.refuse("labware.choice", f"is none of {', '.join(options)}", key)
            return ""
        return found or ""

    def vector(self, key: str) -> Vector:
        """Return an object with x, y and z."""
        inner = self.object(key)
        if inner is None:
            return Vector(0.0, 0.0, 0.0)
        return Vector(*(inner.number(axis, -FARTHEST_MM) for axis in ("x", "y", "z")))

    def object(self, key: str) -> JsonReader | None:
        """Return a reader of an inner object, or None and a finding."""
        found = self._get(key, Mapping, "object")
        return None if found is None else self._inner(found, key)

    def optional_object(self, key: str) -> JsonReader:
        """Return a reader of an inner object; an empty one where nothing is said."""
        return (self.object(key) if self.has(key) else None) or self._inner({}, key)

    def objects(self, key: str, most: int) -> Iterator[JsonReader]:
        """Yield readers of the objects of a list."""
        found = self._get(key, list, "list") or []
        if len(found) > most:
            self.refuse("labware.too_many", f"has {len(found)} entries, more than {most}", key)
            return
        for place, item in enumerate(found):
            if isinstance(item, Mapping):
                yield self._inner(item, f"{key}[{place}]")
            else:
                self.refuse("labware.field", "is no object", f"{key}[{place}]")

    def entries(self, key: str, most: int) -> Iterator[tuple[str, JsonReader]]:
        """Yield name and reader of the objects of an object."""
        inner = self.object(key)
        if inner is None:
            return
        if len(inner.value) > most:
            self.refuse(
                "labware.too_many", f"has {len(inner.value)} entries, more than {most}", key
            )
            return
        for name in inner.value:
            if not self.is_name(name):
                self.refuse("labware.text", f"{str(name)[:40]!r} is no name", key)
            elif (found := inner.object(name)) is not None:
                yield name, found

    def _inner(self, value: Mapping[str, Any], key: str) -> JsonReader:
        return JsonReader(value, f"{self.path}.{key}" if self.path else key, self.findings)

    def done(self, what: str) -> None:
        """Refuse the whole file when anything of it was found wrong.

        Raises:
            DefinitionError: With all findings.
        """
        if self.findings:
            more = len(self.findings) - 1
            raise DefinitionError(
                f"{what} is refused: {self.findings[0].message}"
                + (f" (and {more} more)" if more else ""),
                code="labware.invalid",
                findings=self.findings,
            )


def open_reader(value: object, what: str) -> JsonReader:
    """Return a reader of the outermost value of a file.

    Raises:
        DefinitionError: It is no object.
    """
    if not isinstance(value, Mapping):
        finding = Finding("labware.field", f"{what} is no object")
        raise DefinitionError(finding.message, code="labware.invalid", findings=[finding])
    return JsonReader(value, "")
