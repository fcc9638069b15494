"""Say where a PROV document contradicts itself.

Source:
    PROV-CONSTRAINTS, W3C Recommendation of 30 April 2013: uniqueness (22 to 29), impossibility
    (51 to 56) and typing (50). The order of events (30 to 49) is not judged: it binds no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from labweb.domain.crutd.provenance.prov_json_read import ProvDocument, ProvStatement
from labweb.domain.crutd.provenance.prov_records_table import SHAPES
from labweb.domain.crutd.provenance.qualified_names import PROV
from labweb.domain.errors import Finding

_BASIC = frozenset(
    kind
    for kind, shape in SHAPES.items()
    if shape.has_id and not shape.is_element and kind not in {"wasDerivedFrom", "wasInfluencedBy"}
)
"""Relations of which no two may share a name (constraint 53)."""

_KEYS: dict[str, tuple[str, str]] = {
    "wasGeneratedBy": ("prov:entity", "prov:activity"),
    "wasInvalidatedBy": ("prov:entity", "prov:activity"),
    "wasStartedBy": ("prov:activity", "prov:starter"),
    "wasEndedBy": ("prov:activity", "prov:ender"),
}
"""What there is one of (constraints 24 to 27)."""

_EMPTY = f"{PROV}EmptyCollection"


@dataclass
class _Scope:
    """The statements of one document or bundle, merged as far as they say the same."""

    statements: list[ProvStatement]
    findings: list[Finding]

    def refuse(self, path: str, message: str, code: str) -> None:
        self.findings.append(Finding(code, message, path))

    def of(self, kind: str) -> list[ProvStatement]:
        return [s for s in self.statements if s.kind == kind]


def check_prov(document: ProvDocument) -> list[Finding]:
    """List the contradictions of a document and, each for itself, of its bundles."""
    found: list[Finding] = []
    for part in (document, *document.bundles.values()):
        scope = _Scope(list(part.statements), [])
        for check in _CHECKS:
            check(scope)
        found += scope.findings
    return found


def _check_needed(scope: _Scope) -> None:
    """Say which relations lack an end; they are judged no further."""
    kept = []
    for statement in scope.statements:
        needed = [a.name for a in SHAPES[statement.kind].arguments if a.is_needed]
        missing = [name for name in needed if name not in statement.arguments]
        for name in missing:
            scope.refuse(statement.path, f"{statement.kind} needs {name}", "prov.missing")
        if not missing:
            kept.append(statement)
    scope.statements = kept


def _merge_by_name(scope: _Scope) -> None:
    """Constraints 22 and 23: what has the same name is the same."""
    _merge(scope, lambda s: None if s.id is None or not SHAPES[s.kind].has_id else (s.kind, s.id))


def _merge_by_key(scope: _Scope) -> None:
    """Constraints 24 to 27: one generation by an activity, one start by a starter."""

    def key(statement: ProvStatement) -> tuple[str, ...] | None:
        names = _KEYS.get(statement.kind)
        if names is None or any(name not in statement.arguments for name in names):
            return None
        return (statement.kind, *(statement.arguments[name] for name in names))

    _merge(scope, key)


def _merge(scope: _Scope, key: Callable[[ProvStatement], tuple[str, ...] | None]) -> None:
    first: dict[tuple[str, ...], int] = {}
    merged: list[ProvStatement] = []
    for statement in scope.statements:
        named = key(statement)
        if named is None or named not in first:
            if named is not None:
                first[named] = len(merged)
            merged.append(statement)
            continue
        place = first[named]
        merged[place] = _unified(scope, merged[place], statement)
    scope.statements = merged


def _unified(scope: _Scope, one: ProvStatement, other: ProvStatement) -> ProvStatement:
    arguments = dict(one.arguments)
    for argument in SHAPES[one.kind].arguments:
        name = argument.name
        here, there = one.arguments.get(name), other.arguments.get(name)
        if here == there:
            continue
        if (here is None or there is None) and not argument.is_fixed:
            arguments[name] = here or there or ""
            continue
        message = f"{one.path} says {name} {here or 'none'}, this says {there or 'none'}"
        scope.refuse(other.path, message, "prov.conflict")
    if one.id and other.id and one.id != other.id:
        message = f"{one.path} tells of the same under another name"
        scope.refuse(other.path, message, "prov.conflict")
    return replace(
        one,
        id=one.id or other.id,
        arguments=arguments,
        attributes=(*one.attributes, *other.attributes),
    )


def _check_times(scope: _Scope) -> None:
    """Constraints 28 and 29: an activity starts and ends once."""
    for kind, name in (("wasStartedBy", "prov:startTime"), ("wasEndedBy", "prov:endTime")):
        told = {s.id: s.arguments[name] for s in scope.of("activity") if name in s.arguments}
        for statement in scope.of(kind):
            time = statement.arguments.get("prov:time")
            known = told.get(statement.arguments.get("prov:activity"))
            if time is not None and known is not None and time != known:
                message = f"the activity has {name} {known}, this says {time}"
                scope.refuse(statement.path, message, "prov.conflict")


def _sorts(statements: Iterable[ProvStatement]) -> Iterator[tuple[str, str, str]]:
    """Constraint 50: what each name must be, for it stands where it stands."""
    for statement in statements:
        if SHAPES[statement.kind].is_element and statement.id is not None:
            yield statement.id, statement.kind, statement.path
        for argument in SHAPES[statement.kind].arguments:
            name = statement.arguments.get(argument.name)
            if name is not None and argument.sort in {"entity", "activity", "agent"}:
                yield name, argument.sort, statement.path


def _check_sorts(scope: _Scope) -> None:
    """Constraints 53 to 55: no name stands for two things that cannot be one."""
    sorts: dict[str, dict[str, str]] = {}
    for name, sort, path in _sorts(scope.statements):
        sorts.setdefault(name, {}).setdefault(sort, path)
    for name, found in sorts.items():
        if {"entity", "activity"} <= found.keys():
            path = found["activity"]
            scope.refuse(path, f"{name} is an entity and an activity", "prov.type_conflict")
    relations: dict[str, dict[str, str]] = {}
    for statement in scope.statements:
        shape = SHAPES[statement.kind]
        if shape.is_element or not shape.has_id or statement.id is None:
            continue
        relations.setdefault(statement.id, {})[statement.kind] = statement.path
        if statement.id in sorts:
            message = f"{statement.id} names a relation and a thing"
            scope.refuse(statement.path, message, "prov.type_conflict")
    for name, kinds in relations.items():
        clashing = sorted(_BASIC & kinds.keys())
        if len(clashing) > 1:
            message = f"{name} names {' and '.join(clashing)}"
            scope.refuse(kinds[clashing[1]], message, "prov.type_conflict")


def _check_derivations(scope: _Scope) -> None:
    """Constraint 51: who names no activity names no generation and no usage of it."""
    for statement in scope.of("wasDerivedFrom"):
        told = statement.arguments.keys() & {"prov:generation", "prov:usage"}
        if told and "prov:activity" not in statement.arguments:
            message = f"a derivation with {min(told)} needs prov:activity"
            scope.refuse(statement.path, message, "prov.conflict")


def _check_specializations(scope: _Scope) -> None:
    """Constraint 52: nothing is a special case of itself, not even by way of others."""
    above: dict[str, list[tuple[str, str]]] = {}
    for kind in ("specializationOf", "mentionOf"):
        for statement in scope.of(kind):
            special = statement.arguments["prov:specificEntity"]
            general = statement.arguments["prov:generalEntity"]
            above.setdefault(special, []).append((general, statement.path))
    for path in _cycles(above):
        scope.refuse(path, "an entity is a special case of itself", "prov.conflict")


def _cycles(above: Mapping[str, Sequence[tuple[str, str]]]) -> Iterator[str]:
    """Return a path of each loop; depth first, without recursion."""
    done: set[str] = set()
    for start in above:
        if start in done:
            continue
        trail = {start}
        stack = [(start, iter(above[start]))]
        while stack:
            name, rest = stack[-1]
            step = next(rest, None)
            if step is None:
                trail.discard(name)
                done.add(name)
                stack.pop()
            elif step[0] in trail:
                yield step[1]
            elif step[0] not in done:
                trail.add(step[0])
                stack.append((step[0], iter(above.get(step[0], ()))))


def _check_mentions(scope: _Scope) -> None:
    """PROV-Links: an entity mentions one entity of one bundle."""
    told: dict[str, tuple[str, ...]] = {}
    for statement in scope.of("mentionOf"):
        arguments = statement.arguments
        about = (arguments["prov:generalEntity"], arguments["prov:bundle"])
        if told.setdefault(arguments["prov:specificEntity"], about) != about:
            scope.refuse(statement.path, "it mentions something else already", "prov.conflict")


def _check_members(scope: _Scope) -> None:
    """Constraint 56: an empty collection has no member."""
    empty = {
        s.id
        for s in scope.of("entity")
        if any(name == f"{PROV}type" and value.text == _EMPTY for name, value in s.attributes)
    }
    for statement in scope.of("hadMember"):
        if statement.arguments["prov:collection"] in empty:
            scope.refuse(statement.path, "an empty collection has no member", "prov.conflict")


_CHECKS: tuple[Callable[[_Scope], None], ...] = (
    _check_needed,
    _merge_by_name,
    _merge_by_key,
    # What two keys had in common may make a third one known.
    _merge_by_name,
    _merge_by_key,
    _check_times,
    _check_sorts,
    _check_derivations,
    _check_specializations,
    _check_mentions,
    _check_members,
)
