"""From a parsed driver module to its `DriverSpec`; foreign plain classes are read as well."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from drivers.catalog.annotations import (
    Names,
    as_number,
    last_name,
    literal,
    module_names,
    parameter,
    parse_annotation,
)
from drivers.catalog.source import PACKAGE as PACKAGE
from drivers.catalog.source import Source, read_source
from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec, ParameterSpec, StatusSpec

LIFECYCLE = frozenset(
    {"connect", "close", "stop", "clear_stop", "identify", "halt", "pause", "rest"}
    | {"refuse_if_stopped", "is_stopped", "picture"}
)
"""What the base class gives, or asks for: neither actions nor statuses."""

_TRANSPORTS = {"ByteTransport": "byte", "RegisterTransport": "register"} | {
    "HttpTransport": "http",
    "OpcUaTransport": "opcua",
    "Ros2Transport": "ros2",
    "S7Transport": "s7",
    "SilaTransport": "sila",
    "VirtualTransport": "virtual",
}
_NOT_DEVICES = frozenset(
    {"Struct", "NamedTuple", "TypedDict", "Protocol", "ABC", "Enum", "StrEnum", "IntEnum"}
    | {"Exception", "BaseException", "BaseModel"}
)
_QUALITIES = ("bronze", "silver", "gold")

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True, slots=True)
class Interface:
    """A role as its file declares it."""

    name: str
    role: str
    methods: Mapping[str, Function]
    names: Names


@dataclass(frozen=True, slots=True)
class DriverClass:
    """The class of a driver module, with what its text says."""

    source: Source
    node: ast.ClassDef
    is_driver: bool
    """It derives from our base class; else it is foreign."""

    actions: Mapping[str, Function]
    statuses: Mapping[str, Function]
    interfaces: tuple[Interface, ...]
    config_fields: tuple[ast.AnnAssign, ...]
    names: Names


def device_classes(tree: ast.Module) -> list[ast.ClassDef]:
    """List the public top-level classes that may stand for an instrument."""
    return [
        node
        for node in tree.body
        if isinstance(node, ast.ClassDef)
        and not node.name.startswith("_")
        and not {last_name(base) for base in node.bases} & _NOT_DEVICES
        and not any(last_name(base).endswith("Error") for base in node.bases)
        and not any(last_name(mark) == "dataclass" for mark in node.decorator_list)
        and (_methods(node) or _derives_from_driver(node))
    ]


def read_class(source: Source, node: ast.ClassDef) -> DriverClass:
    """Sort the methods of a class into actions and statuses."""
    is_driver = _derives_from_driver(node)
    sort = _sort_marked if is_driver else _sort_foreign
    sorted_methods = [(sort(method), method) for method in _methods(node)]
    return DriverClass(
        source=source,
        node=node,
        is_driver=is_driver,
        actions={method.name: method for kind, method in sorted_methods if kind == "action"},
        statuses={method.name: method for kind, method in sorted_methods if kind == "status"},
        interfaces=_interfaces_of(source.tree, node),
        config_fields=tuple(_config_fields(source.tree, node)),
        names=module_names(source.tree),
    )


def build_spec(driver: DriverClass) -> DriverSpec:
    """Render what the text of a driver says."""
    lines = module_lines(driver.source.tree)
    quality, _, note = lines.get("Quality", "").partition(",")
    transport = next(
        (_TRANSPORTS[name] for name in _base_arguments(driver.node) if name in _TRANSPORTS), ""
    )
    return DriverSpec(
        class_name=driver.node.name,
        module=driver.source.module,
        digest=driver.source.digest,
        roles=tuple(interface.role for interface in driver.interfaces),
        transport=transport,
        doc=_first_line(driver.node),
        protocol=lines.get("Protocol", ""),
        quality=quality.strip() if quality.strip() in _QUALITIES else "",  # type: ignore[arg-type]
        quality_note=note.strip(),
        safe_state=lines.get("Safe state", ""),
        actions=tuple(_action(driver, method) for method in driver.actions.values()),
        statuses=tuple(_status(driver, method) for method in driver.statuses.values()),
        config=tuple(_settings(driver)),
        imports=driver.source.imports,
    )


def module_lines(tree: ast.Module) -> dict[str, str]:
    """Return the `Protocol:`, `Quality:` and `Safe state:` lines of a module's docstring."""
    text = ast.get_docstring(tree) or ""
    found = re.findall(r"^(Protocol|Quality|Safe state): *(\S.*)$", text, re.MULTILINE)
    return {name: printable(value.strip()) for name, value in found}


def printable(text: str) -> str:
    """Replace what no database keeps: half surrogates and U+0000, written as escapes."""
    return text.encode("utf-8", "replace").decode("utf-8").replace("\0", "?")


def mark_of(method: Function, name: str) -> dict[str, Any] | None:
    """Return the literal keywords of `@action(…)` or `@status(…)`, None without the mark."""
    for mark in method.decorator_list:
        if last_name(mark) == name:
            keywords = mark.keywords if isinstance(mark, ast.Call) else []
            read = {keyword.arg: literal(keyword.value) for keyword in keywords if keyword.arg}
            return {key: value for key, (is_known, value) in read.items() if is_known}
    return None


def arguments_of(method: Function) -> list[tuple[ast.arg, ast.expr | None]]:
    """Return the arguments after `self`, each with its default."""
    plain = [*method.args.posonlyargs, *method.args.args]
    missing: list[ast.expr | None] = [None] * (len(plain) - len(method.args.defaults))
    pairs = list(zip(plain, [*missing, *method.args.defaults], strict=True))
    keyword_only = zip(method.args.kwonlyargs, method.args.kw_defaults, strict=True)
    return [*pairs[1:], *keyword_only]


@cache
def known_interfaces() -> Mapping[str, Interface]:
    """Read the roles that this package declares, by class name."""
    found: dict[str, Interface] = {}
    for path in sorted((PACKAGE / "interfaces").glob("[!_]*.py")):
        tree = read_source(path).tree
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                methods = {method.name: method for method in _methods(node)}
                role = re.sub(r"(?<!^)(?=[A-Z])", "_", node.name).lower()
                found[node.name] = Interface(node.name, role, methods, module_names(tree))
    return found


def _interfaces_of(tree: ast.Module, node: ast.ClassDef) -> tuple[Interface, ...]:
    imported = {
        alias.asname or alias.name: alias.name
        for line in tree.body
        if isinstance(line, ast.ImportFrom) and (line.module or "").startswith("drivers.interfaces")
        for alias in line.names
    }
    wanted = [imported.get(last_name(base), "") for base in node.bases]
    return tuple(known_interfaces()[name] for name in wanted if name in known_interfaces())


def _methods(node: ast.ClassDef) -> list[Function]:
    return [
        member
        for member in node.body
        if isinstance(member, Function) and not member.name.startswith("_")
    ]


def _derives_from_driver(node: ast.ClassDef) -> bool:
    return any(last_name(base) == "Driver" for base in node.bases)


def _sort_marked(method: Function) -> str:
    marks = {last_name(mark) for mark in method.decorator_list}
    return next((kind for kind in ("action", "status") if kind in marks), "")


def _sort_foreign(method: Function) -> str:
    marks = {last_name(mark) for mark in method.decorator_list}
    if method.name in LIFECYCLE or marks & {"staticmethod", "classmethod", "setter", "deleter"}:
        return ""
    if kind := _sort_marked(method):
        return kind
    takes_nothing = not arguments_of(method)
    reads = method.name.startswith(("get_", "is_", "has_", "read_")) or "property" in marks
    return "status" if takes_nothing and reads else "action"


def _base_arguments(node: ast.ClassDef) -> list[str]:
    for base in node.bases:
        if isinstance(base, ast.Subscript) and last_name(base) == "Driver":
            inner = base.slice.elts if isinstance(base.slice, ast.Tuple) else [base.slice]
            return [last_name(part) for part in inner]
    return []


def _config_fields(tree: ast.Module, node: ast.ClassDef) -> Iterator[ast.AnnAssign]:
    wanted = {*_base_arguments(node)[1:2], "Config"}
    for other in tree.body:
        if isinstance(other, ast.ClassDef) and other.name in wanted:
            yield from (line for line in other.body if isinstance(line, ast.AnnAssign))
            return


def _settings(driver: DriverClass) -> Iterator[ParameterSpec]:
    documented = _field_docs(driver)
    for field in driver.config_fields:
        name = last_name(field.target)
        annotation = parse_annotation(field.annotation, driver.names)
        yield parameter(name, annotation, default=field.value, doc=documented.get(name, ""))
    if driver.is_driver or driver.config_fields:
        return
    for member in driver.node.body:
        if isinstance(member, Function) and member.name == "__init__":
            yield from _parameters(member, driver.names)


def _field_docs(driver: DriverClass) -> dict[str, str]:
    docs: dict[str, str] = {}
    for node in driver.source.tree.body:
        if not isinstance(node, ast.ClassDef):
            continue
        for field, after in zip(node.body, node.body[1:], strict=False):
            if not isinstance(field, ast.AnnAssign) or field not in driver.config_fields:
                continue
            if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                docs[last_name(field.target)] = printable(" ".join(str(after.value.value).split()))
    return docs


def _parameters(method: Function, names: Names) -> list[ParameterSpec]:
    return [
        parameter(argument.arg, parse_annotation(argument.annotation, names), default=default)
        for argument, default in arguments_of(method)
    ]


def _action(driver: DriverClass, method: Function) -> ActionSpec:
    mark = mark_of(method, "action") or {}
    hazards = mark.get("hazards", ())
    return ActionSpec(
        name=method.name,
        parameters=tuple(_parameters(method, driver.names)),
        doc=_first_line(method),
        timeout_s=as_number(mark.get("timeout_s")),
        recovery=_one_of(mark.get("recovery"), ("R0", "R1", "R2", "R3"), "R3"),
        hazards=tuple(map(str, hazards)) if isinstance(hazards, list | tuple) else (),
        operation=_one_of(mark.get("operation"), ("read", "update", "transfer"), "update"),
        is_async=isinstance(method, ast.AsyncFunctionDef),
        role=_role_of(driver, method.name),
    )


def _status(driver: DriverClass, method: Function) -> StatusSpec:
    doc = _first_line(method)
    annotation = parse_annotation(method.returns, driver.names)
    return StatusSpec(
        name=method.name,
        value=parameter(method.name.removeprefix("get_"), annotation, doc=doc),
        doc=doc,
        every_s=as_number((mark_of(method, "status") or {}).get("every_s")),
        role=_role_of(driver, method.name),
    )


def _role_of(driver: DriverClass, name: str) -> str:
    return next((face.role for face in driver.interfaces if name in face.methods), "")


def _one_of(value: object, allowed: tuple[str, ...], otherwise: str) -> Any:  # noqa: ANN401
    return value if value in allowed else otherwise


def _first_line(node: ast.ClassDef | Function) -> str:
    text = (ast.get_docstring(node) or "").strip()
    return printable(text.splitlines()[0]) if text else ""
