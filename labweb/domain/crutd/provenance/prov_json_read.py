"""Read PROV-JSON that others wrote, or say what is wrong with it and where."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeGuard

from labweb.domain.crutd.provenance.prov_records_table import SHAPES, Argument
from labweb.domain.crutd.provenance.prov_values import Literal, read_time, read_value
from labweb.domain.crutd.provenance.qualified_names import BUILT_IN, DEFAULT, expand
from labweb.domain.errors import DefinitionError, Finding

MOST_BYTES = 64 * 2**20
_MOST_FINDINGS = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvStatement:
    """One record of a document, with all names written out."""

    kind: str
    """As PROV-JSON has it: `entity`, `used`, …"""

    id: str | None
    """None when it has no name of its own, or a blank one."""

    arguments: Mapping[str, str]
    """Formal arguments: full names, and times in UTC where their zone is known."""

    attributes: tuple[tuple[str, Literal], ...] = ()
    path: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvDocument:
    """A document, or one of its bundles."""

    statements: tuple[ProvStatement, ...]
    bundles: Mapping[str, ProvDocument] = field(default_factory=dict)


def read_prov(raw: bytes) -> ProvDocument:
    """Read a PROV-JSON document whole.

    Raises:
        DefinitionError: It is malformed; each finding names a place, as a path of keys.
    """
    reader = _Reader()
    document = reader.document(reader.parse(raw), "", dict(BUILT_IN))
    if reader.findings or document is None:
        first = reader.findings[0]
        where = f" at {first.subject}" if first.subject else ""
        raise DefinitionError(
            f"this is no PROV-JSON document: {first.message}{where}",
            code="prov.malformed",
            findings=reader.findings[:_MOST_FINDINGS],
        )
    return document


class _Pairs(dict[str, Any]):
    """A JSON object that remembers which keys stood in it twice."""

    twice: tuple[str, ...] = ()


def _pairs(pairs: list[tuple[str, Any]]) -> _Pairs:
    found = _Pairs(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        found.twice = tuple(sorted({key for key in keys if keys.count(key) > 1}))
    return found


def _refuse_constant(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")


class _Reader:
    """Collects findings while it reads."""

    def __init__(self) -> None:
        self.findings: list[Finding] = []

    def refuse(self, path: str, message: str, code: str) -> None:
        """Note one thing that is wrong."""
        self.findings.append(Finding(code, message, path))

    def parse(self, raw: bytes) -> object:
        """Read the JSON text; None, with a finding, when it is none."""
        if len(raw) > MOST_BYTES:
            self.refuse("", f"{len(raw)} bytes are more than can be read", "prov.not_json")
            return None
        try:
            return json.loads(
                raw.decode("utf-8"), object_pairs_hook=_pairs, parse_constant=_refuse_constant
            )
        except (ValueError, RecursionError) as error:
            self.refuse("", f"not JSON: {error}", "prov.not_json")
            return None

    def document(
        self, value: object, path: str, above: Mapping[str, str], *, is_bundle: bool = False
    ) -> ProvDocument | None:
        """Read a document or bundle; None, with a finding, when it is no object."""
        if self.findings and not path:
            return None
        if not self._is_object(value, path):
            return None
        prefixes = {**above, **self._prefixes(value.get("prefix", _Pairs()), _at(path, "prefix"))}
        statements: list[ProvStatement] = []
        bundles: dict[str, ProvDocument] = {}
        for kind, records in value.items():
            where = _at(path, kind)
            if kind == "prefix":
                continue
            if kind == "bundle" and not is_bundle:
                bundles = self._bundles(records, where, prefixes)
            elif kind not in SHAPES:
                self.refuse(where, f"{kind} is no record of PROV", "prov.unknown_record")
            elif self._is_object(records, where):
                statements += self._records(kind, records, where, prefixes)
        return ProvDocument(statements=tuple(statements), bundles=bundles)

    def _is_object(self, value: object, path: str) -> TypeGuard[dict[str, Any]]:
        if not isinstance(value, dict):
            self.refuse(path, f"an object is needed, not {_sort(value)}", "prov.shape")
            return False
        for key in getattr(value, "twice", ()):
            self.refuse(_at(path, key), f"{key} stands here twice", "prov.duplicate_key")
        return True

    def _prefixes(self, value: object, path: str) -> dict[str, str]:
        if not self._is_object(value, path):
            return {}
        found = {}
        for prefix, space in value.items():
            if not isinstance(space, str) or not space:
                self.refuse(_at(path, prefix), "a namespace is a text", "prov.shape")
            elif prefix in BUILT_IN and space.rstrip("#") != BUILT_IN[prefix].rstrip("#"):
                message = f"{prefix} always stands for {BUILT_IN[prefix]}"
                self.refuse(_at(path, prefix), message, "prov.undeclared_prefix")
            elif prefix not in BUILT_IN:
                found[prefix] = space
        return found

    def _bundles(
        self, value: object, path: str, prefixes: Mapping[str, str]
    ) -> dict[str, ProvDocument]:
        found: dict[str, ProvDocument] = {}
        if not self._is_object(value, path):
            return found
        for name, content in value.items():
            where = _at(path, name)
            full = self.name(name, where, prefixes)
            inside = self.document(content, where, prefixes, is_bundle=True)
            if full is not None and inside is not None:
                found[full] = inside
        return found

    def _records(
        self, kind: str, records: Mapping[str, Any], path: str, prefixes: Mapping[str, str]
    ) -> Iterator[ProvStatement]:
        for name, contents in records.items():
            where = _at(path, name)
            full = self.name(name, where, prefixes)
            many = contents if isinstance(contents, list) else [contents]
            for place, content in enumerate(many):
                spot = _at(where, place) if isinstance(contents, list) else where
                if self._is_object(content, spot):
                    yield self._record(kind, full, content, spot, prefixes)

    def _record(
        self,
        kind: str,
        name: str | None,
        content: Mapping[str, Any],
        path: str,
        prefixes: Mapping[str, str],
    ) -> ProvStatement:
        shape = SHAPES[kind]
        formal = {argument.name: argument for argument in shape.arguments}
        arguments: dict[str, str] = {}
        attributes: list[tuple[str, Literal]] = []
        for key, value in content.items():
            where = _at(path, key)
            if key in formal:
                told = self._argument(formal[key], value, where, prefixes)
                if told is not None:
                    arguments[key] = told
            else:
                attributes += self._attribute(key, value, where, prefixes)
        is_blank = name is None or name.startswith("_:")
        return ProvStatement(
            kind=kind,
            id=name if shape.is_element or not is_blank else None,
            arguments=arguments,
            attributes=tuple(attributes),
            path=path,
        )

    def _argument(
        self, argument: Argument, value: object, path: str, prefixes: Mapping[str, str]
    ) -> str | None:
        if isinstance(value, list) and len(value) == 1:
            value = value[0]
        if isinstance(value, dict) and argument.sort == "time":
            value = value.get("$")
        if not isinstance(value, str):
            self.refuse(path, f"a text is needed, not {_sort(value)}", "prov.shape")
            return None
        if argument.sort != "time":
            return self.name(value, path, prefixes)
        time = read_time(value)
        if time is None:
            self.refuse(path, f"{value!r} is no time of ISO 8601", "prov.value")
        return time

    def _attribute(
        self, key: str, value: object, path: str, prefixes: Mapping[str, str]
    ) -> Iterator[tuple[str, Literal]]:
        name = self.name(key, path, prefixes)
        many = value if isinstance(value, list) else [value]
        for place, one in enumerate(many):
            spot = _at(path, place) if isinstance(value, list) else path
            literal, message = read_value(one, prefixes)
            if literal is None:
                self.refuse(spot, message, "prov.value")
            elif name is not None:
                yield name, literal

    def name(self, text: str, path: str, prefixes: Mapping[str, str]) -> str | None:
        """Write a name out; None, with a finding, when its prefix is not declared."""
        full = expand(text, prefixes)
        if full is None:
            prefix = text.partition(":")[0] if ":" in text else DEFAULT
            self.refuse(path, f"nobody declared the prefix {prefix}", "prov.undeclared_prefix")
        return full


def _at(path: str, key: object) -> str:
    return f"{path}/{key}" if path else str(key)


def _sort(value: object) -> str:
    names = {dict: "an object", list: "a list", str: "a text", bool: "a truth value"}
    return "null" if value is None else names.get(type(value), "a number")
