"""From the text of an annotation to what a JSON value must be."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import msgspec

from labweb.domain.enrollment.driver_spec import (
    UNITS,
    AccuracySpec,
    JsonType,
    ParameterSpec,
    unit_suffix,
)

_SCALARS: Mapping[str, JsonType] = {
    "float": "number",
    "int": "integer",
    "bool": "boolean",
    "str": "string",
    "None": "null",
}
_CONTAINERS: Mapping[str, JsonType] = {
    "list": "array",
    "tuple": "array",
    "Sequence": "array",
    "dict": "object",
    "Mapping": "object",
}
_OF_VALUE: Mapping[type, JsonType] = {
    str: "string",
    bool: "boolean",
    int: "integer",
    float: "number",
}
_NUL = re.compile(rb"(?<!\\)(?:\\\\)*\\u0000")
"""U+0000 in JSON: the escape, and not a backslash followed by its letters."""

_DEEPEST = 8
"""Aliases of aliases are followed this far."""


@dataclass(frozen=True, slots=True)
class Annotation:
    """What an annotation says about a value."""

    type: JsonType
    nullable: bool = False
    minimum: float | None = None
    maximum: float | None = None
    quantity: str = ""
    choices: tuple[Any, ...] = ()
    accuracy: AccuracySpec | None = None


@dataclass(frozen=True, slots=True)
class Names:
    """What the module's own names stand for."""

    aliases: Mapping[str, ast.expr]
    enums: Mapping[str, tuple[Any, ...]]


def module_names(tree: ast.Module) -> Names:
    """Collect aliases (`Volume = Annotated[…]`) and enumerations of literals."""
    aliases: dict[str, ast.expr] = {}
    enums: dict[str, tuple[Any, ...]] = {}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            aliases[node.targets[0].id] = node.value
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value:
            aliases[node.target.id] = node.value
        elif isinstance(node, ast.ClassDef) and _is_enum(node):
            enums[node.name] = _enum_values(node)
    return Names(aliases, enums)


def parse_annotation(node: ast.expr | None, names: Names, depth: int = 0) -> Annotation | None:
    """Read an annotation; None when it names no JSON-able type.

    Ranges are written `Annotated[float, Range(0, 310)]`, choices as `Literal[…]` or an enum.
    """
    if node is None or depth > _DEEPEST:
        return None
    if isinstance(node, ast.Constant):
        return _parse_constant(node, names, depth)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
        return _parse_union([node.left, node.right], names, depth)
    if isinstance(node, ast.Subscript):
        return _parse_subscript(node, names, depth)
    return _parse_name(last_name(node), names, depth)


def parameter(
    name: str, annotation: Annotation | None, *, default: ast.expr | None = None, doc: str = ""
) -> ParameterSpec:
    """Build the spec of one named value: unit from the name, the rest from the annotation."""
    is_known, value = literal(default)
    unit = unit_suffix(name) if annotation is None or is_number(annotation) else ""
    words = name.removesuffix(f"_{unit}") if unit else name
    spec = ParameterSpec(
        name=name,
        unit=unit,
        label=words.replace("_", " ").capitalize(),
        doc=doc,
        required=default is None,
        default=value if is_known else None,
        quantity=UNITS[unit][0] if unit else "",
    )
    if annotation is None:
        return spec
    return msgspec.structs.replace(
        spec,
        quantity=annotation.quantity or spec.quantity,
        type=annotation.type,
        nullable=annotation.nullable,
        minimum=annotation.minimum,
        maximum=annotation.maximum,
        choices=annotation.choices,
        accuracy=annotation.accuracy,
    )


def is_number(annotation: Annotation) -> bool:
    """Tell whether a value of this annotation is a bare number."""
    return annotation.type in {"number", "integer"}


def last_name(node: ast.AST | None) -> str:
    """Return the last part of a dotted name, looking through calls and subscripts."""
    while isinstance(node, ast.Call | ast.Subscript):
        node = node.func if isinstance(node, ast.Call) else node.value
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def literal(node: ast.expr | None) -> tuple[bool, Any]:
    """Return (True, value) for a JSON-able literal, else (False, None).

    Text with U+0000 is none: no database keeps it.
    """
    if node is None:
        return False, None
    try:
        value = ast.literal_eval(node)
        if isinstance(value, float) and not math.isfinite(value):
            return False, None
        raw = msgspec.json.encode(value)
        if _NUL.search(raw):
            return False, None
        value = msgspec.json.decode(raw)  # a tuple is a list from now on
    except (ValueError, TypeError, SyntaxError, OverflowError, RecursionError, MemoryError):
        return False, None
    except msgspec.DecodeError:
        return False, None
    is_jsonable = value is None or isinstance(value, bool | int | float | str | list)
    return (True, value) if is_jsonable else (False, None)


def _parse_constant(node: ast.Constant, names: Names, depth: int) -> Annotation | None:
    if node.value is None:
        return Annotation("null")
    if not isinstance(node.value, str):
        return None
    try:
        inner = ast.parse(node.value, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    return parse_annotation(inner, names, depth + 1)


def _parse_union(nodes: list[ast.expr], names: Names, depth: int) -> Annotation | None:
    if len(nodes) > 2:  # one type and None is all that this can tell apart
        return None
    parts = [parse_annotation(node, names, depth + 1) for node in nodes]
    kept = [part for part in parts if part is not None and part.type != "null"]
    if None in parts or len(kept) != 1:
        return None
    has_none = any(part is not None and part.type == "null" for part in parts)
    return replace(kept[0], nullable=has_none or kept[0].nullable)


def _parse_subscript(node: ast.Subscript, names: Names, depth: int) -> Annotation | None:
    outer = last_name(node.value)
    inner = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    if outer == "Literal":
        return _parse_literal(inner)
    if outer == "Optional":
        return _parse_union([*inner, ast.Constant(None)], names, depth)
    if outer == "Union":
        return _parse_union(inner, names, depth)
    if outer == "Annotated" and inner:
        return _parse_annotated(inner, names, depth)
    return Annotation(_CONTAINERS[outer]) if outer in _CONTAINERS else None


def _parse_literal(nodes: list[ast.expr]) -> Annotation | None:
    read = [literal(node) for node in nodes]
    values = tuple(value for is_known, value in read if is_known and value is not None)
    types = {_OF_VALUE.get(type(value)) for value in values}
    found = types.pop() if len(types) == 1 else None
    if found is None or not all(is_known for is_known, _ in read):
        return None
    return Annotation(found, nullable=len(values) < len(read), choices=values)


def _parse_annotated(nodes: list[ast.expr], names: Names, depth: int) -> Annotation | None:
    parsed = parse_annotation(nodes[0], names, depth + 1)
    for marker in nodes[1:]:
        if parsed is not None and isinstance(marker, ast.Call):
            parsed = _apply_marker(parsed, marker)
    return parsed


def _apply_marker(parsed: Annotation, marker: ast.Call) -> Annotation:
    keywords = {keyword.arg: keyword.value for keyword in marker.keywords if keyword.arg}
    arguments = dict(zip(("first", "second"), marker.args, strict=False))
    if last_name(marker) == "Range":
        low = _number(keywords.get("minimum", arguments.get("first")))
        high = _number(keywords.get("maximum", arguments.get("second")))
        return replace(parsed, minimum=low, maximum=high)
    if last_name(marker) == "Meta":
        low, high = _number(keywords.get("ge")), _number(keywords.get("le"))
        return replace(parsed, minimum=low, maximum=high)
    if last_name(marker) == "Accuracy":
        ratio = _number(keywords.get("ratio", arguments.get("first")))
        absolute = _number(keywords.get("absolute", arguments.get("second")))
        return replace(parsed, accuracy=AccuracySpec(ratio=ratio, absolute=absolute))
    _, name = literal(keywords.get("name", arguments.get("first")))
    if last_name(marker) == "Quantity" and isinstance(name, str):
        return replace(parsed, quantity=name)
    return parsed


def as_number(value: object) -> float | None:
    """Return a finite number as a float, None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return None


def _number(node: ast.expr | None) -> float | None:
    return as_number(literal(node)[1])


def _parse_name(name: str, names: Names, depth: int) -> Annotation | None:
    if name in names.enums:
        values = names.enums[name]
        types = {_OF_VALUE[type(value)] for value in values}
        return Annotation(types.pop(), choices=values) if len(types) == 1 else None
    if name in _SCALARS:
        return Annotation(_SCALARS[name])
    if name in _CONTAINERS:
        return Annotation(_CONTAINERS[name])
    return parse_annotation(names.aliases.get(name), names, depth + 1)


def _is_enum(node: ast.ClassDef) -> bool:
    return any(last_name(base) in {"Enum", "StrEnum", "IntEnum"} for base in node.bases)


def _enum_values(node: ast.ClassDef) -> tuple[Any, ...]:
    assigned = [literal(line.value) for line in node.body if isinstance(line, ast.Assign)]
    return tuple(value for is_known, value in assigned if is_known and type(value) in _OF_VALUE)
