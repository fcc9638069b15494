"""The rules DRV001 to DRV012 that driver source must keep, each finding with file and line."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from drivers.catalog.annotations import (
    Annotation,
    as_number,
    is_number,
    last_name,
    literal,
    parse_annotation,
)
from drivers.catalog.imports import check_imports
from drivers.catalog.inspect import (
    DriverClass,
    Function,
    Interface,
    arguments_of,
    device_classes,
    module_lines,
)
from drivers.catalog.source import Source
from drivers.catalog.timeouts_and_intervals import marks, timeouts
from labweb.domain.enrollment.driver_spec import UNITS, unit_suffix
from labweb.domain.errors import Finding

QUALITIES = ("bronze", "silver", "gold")
TOGGLES = ("toggle_", "flip_", "switch_")

HARMLESS_CALLS = frozenset(
    {"compile", "frozenset", "MappingProxyType", "TypeVar", "NewType", "ParamSpec"}
    | {"Range", "Quantity", "Accuracy", "Meta", "field"}
    | {"action", "status", "dataclass", "override"}
)
"""Calls that build a constant or leave a mark: all that may happen on import."""

_SECTION = re.compile(r"§|\b(section|chapter|manual|table|appendix)\b", re.IGNORECASE)
_SENDERS = frozenset({"exchange", "send", "read_registers", "write_registers", "write_register"})
_PLAIN_NUMBERS = frozenset({0, 1})


def check_module(source: Source) -> list[Finding]:
    """List what the module breaks apart from any one class."""
    rules = (
        _one_class,
        _module_docstring,
        _calls_on_import,
        check_imports,
        _frame_numbers,
        _ranges,
    )
    return [finding for rule in rules for finding in rule(source)]


def _ranges(source: Source) -> Iterator[Finding]:
    """A bound that cannot be read would be none: host and server check what stands in the text."""
    for marker in _markers(source):
        if isinstance(marker, ast.Name | ast.Attribute):
            yield source.finding(
                "drv002",
                marker.lineno,
                f"what {ast.unparse(marker)} limits cannot be read",
                "write the range where it applies: Annotated[float, Range(0, 310)]",
            )
        elif isinstance(marker, ast.Call) and last_name(marker) in {"Range", "Meta"}:
            words = {"pattern", "title", "description", "examples"}
            bounds = [*marker.args, *(one.value for one in marker.keywords if one.arg not in words)]
            for bound in bounds:
                if not _is_bound(bound):
                    yield source.finding(
                        "drv002",
                        bound.lineno,
                        f"the bound {ast.unparse(bound)[:80]} of a range is no plain number",
                        "write the number itself, or None for no bound",
                    )


def _markers(source: Source) -> Iterator[ast.expr]:
    for node in source.find(ast.Subscript):
        if last_name(node.value) == "Annotated" and isinstance(node.slice, ast.Tuple):
            yield from node.slice.elts[1:]


def _is_bound(node: ast.expr) -> bool:
    is_known, value = literal(node)
    return is_known and (value is None or as_number(value) is not None)


def check_driver(driver: DriverClass) -> list[Finding]:
    """List what one driver class breaks."""
    rules = (
        _annotated,
        _units,
        timeouts,
        marks,
        _docstrings,
        _toggles,
        _interface,
        _base,
        _awaited,
    )
    return [finding for rule in rules for finding in rule(driver)]


def _one_class(source: Source) -> Iterator[Finding]:
    nodes = device_classes(source.tree)
    if len(nodes) != 1:
        line = nodes[1].lineno if nodes else 1
        names = ", ".join(node.name for node in nodes) or "none"
        yield source.finding(
            "drv001",
            line,
            f"one driver class per file; here are {len(nodes)}: {names}",
            "move each instrument model to its own file; start helper classes with _",
        )


def _base(driver: DriverClass) -> Iterator[Finding]:
    if not driver.is_driver:
        yield driver.source.finding(
            "drv001",
            driver.node.lineno,
            f"{driver.node.name} is not a Driver",
            f"class {driver.node.name}(Driver[ByteTransport, Config], …)",
        )


def _awaited(driver: DriverClass) -> Iterator[Finding]:
    """A line calls its driver on plain threads: of an `async def` it would get a coroutine.

    The action would not have run, and a halt would not have stopped anything.
    """
    for member in driver.node.body:
        if isinstance(member, ast.AsyncFunctionDef):
            yield driver.source.finding(
                "drv012",
                member.lineno,
                f"{member.name} is async: nobody awaits it, so it would never run",
                f"def {member.name}(…): wait with self.pause() and transport.exchange()",
            )


def _annotated(driver: DriverClass) -> Iterator[Finding]:
    finding = driver.source.finding
    for method in _marked(driver):
        if method.args.vararg or method.args.kwarg:
            yield finding(
                "drv002",
                method.lineno,
                f"{method.name} takes *args or **kwargs",
                "name each parameter",
            )
        for argument, _ in arguments_of(method):
            if parse_annotation(argument.annotation, driver.names) is None:
                yield finding(
                    "drv002",
                    argument.lineno,
                    f"{method.name}: {argument.arg} has no JSON-able annotation",
                    f"{argument.arg}: float, int, str, bool, Literal[…] or an enum",
                )
        if not _returns_json(driver, method):
            yield finding(
                "drv002",
                method.lineno,
                f"{method.name} has no JSON-able return annotation",
                "-> Report for an action, -> float for a status",
            )


def _returns_json(driver: DriverClass, method: Function) -> bool:
    if method.name in driver.actions and last_name(method.returns) == "Report":
        return True
    annotation = parse_annotation(method.returns, driver.names)
    if annotation is None:
        return False
    return method.name in driver.actions or annotation.type != "null"


def _units(driver: DriverClass) -> Iterator[Finding]:
    for name, line, annotation in _named_values(driver):
        is_bare = annotation is not None and is_number(annotation) and not annotation.choices
        if is_bare and not unit_suffix(name):
            yield driver.source.finding(
                "drv003",
                line,
                f"the name {name} carries a number and no unit",
                f"end it in one of: {', '.join(f'_{unit}' for unit in UNITS)}",
            )


def _named_values(driver: DriverClass) -> Iterator[tuple[str, int, Annotation | None]]:
    for method in _marked(driver):
        for argument, _ in arguments_of(method):
            annotation = parse_annotation(argument.annotation, driver.names)
            yield argument.arg, argument.lineno, annotation
    for method in driver.statuses.values():
        yield method.name, method.lineno, parse_annotation(method.returns, driver.names)
    for field in driver.config_fields:
        annotation = parse_annotation(field.annotation, driver.names)
        yield last_name(field.target), field.lineno, annotation


def _module_docstring(source: Source) -> Iterator[Finding]:
    lines = module_lines(source.tree)
    if "Protocol" not in lines:
        yield source.finding(
            "drv005", 1, "the module's docstring has no Protocol: line", "Protocol: name, settings"
        )
    if lines.get("Quality", "").partition(",")[0].strip() not in QUALITIES:
        yield source.finding(
            "drv005",
            1,
            "the module's docstring has no Quality: line of bronze, silver or gold",
            "Quality: bronze, simulated instrument",
        )


def _docstrings(driver: DriverClass) -> Iterator[Finding]:
    for node in (driver.node, *_marked(driver)):
        if not (ast.get_docstring(node) or "").strip():
            yield driver.source.finding(
                "drv005", node.lineno, f"{node.name} has no docstring", "say what it does"
            )


def _toggles(driver: DriverClass) -> Iterator[Finding]:
    for member in driver.node.body:
        if isinstance(member, Function) and member.name.startswith(TOGGLES):
            yield driver.source.finding(
                "drv006",
                member.lineno,
                f"{member.name} depends on the state before: sent twice it undoes itself",
                "state what is wanted: set_light(is_on=True)",
            )


def _calls_on_import(source: Source) -> Iterator[Finding]:
    for node in _run_on_import(source.tree):
        if isinstance(node, ast.Call) and last_name(node) not in HARMLESS_CALLS:
            yield source.finding(
                "drv007",
                node.lineno,
                f"{last_name(node) or 'something'}() is called on import",
                "move it into a method",
            )
        elif isinstance(node, ast.For | ast.While | ast.With | ast.Try | ast.Delete | ast.Raise):
            yield source.finding(
                "drv007",
                node.lineno,
                "a statement runs on import",
                "a driver module holds imports, constants, functions and classes",
            )


def _run_on_import(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield the nodes that Python evaluates when the module is imported."""
    pending: list[ast.AST] = [tree]
    while pending:
        node = pending.pop()
        yield node
        if isinstance(node, Function):
            defaults = [default for default in node.args.kw_defaults if default is not None]
            pending += [*node.decorator_list, *node.args.defaults, *defaults]
        elif isinstance(node, ast.Lambda):
            continue
        else:
            pending.extend(ast.iter_child_nodes(node))


def _interface(driver: DriverClass) -> Iterator[Finding]:
    if driver.is_driver and not driver.interfaces:
        yield driver.source.finding(
            "drv008",
            driver.node.lineno,
            f"{driver.node.name} has no interface",
            "name its role among the base classes: Pump, Valve, Balance, …",
        )
    for face in driver.interfaces:
        for name, wanted in face.methods.items():
            yield from _interface_method(driver, face, name, wanted)


def _interface_method(
    driver: DriverClass, face: Interface, name: str, wanted: Function
) -> Iterator[Finding]:
    method = driver.actions.get(name) or driver.statuses.get(name)
    if method is None:
        yield driver.source.finding(
            "drv008",
            driver.node.lineno,
            f"{face.name}.{name} is missing, or not marked",
            f"write {name} under @action(timeout_s=…) or @status(every_s=…)",
        )
        return
    has = [
        (argument.arg, _type(argument.annotation, driver)) for argument, _ in arguments_of(method)
    ]
    want = [
        (argument.arg, _type(argument.annotation, face)) for argument, _ in arguments_of(wanted)
    ]
    if has != want:
        shown = ", ".join(f"{argument}: {kind}" for argument, kind in want)
        yield driver.source.finding(
            "drv008",
            method.lineno,
            f"{name} differs from {face.name}.{name}",
            f"def {name}(self, {shown})" if shown else f"def {name}(self)",
        )


def _type(annotation: ast.expr | None, owner: DriverClass | Interface) -> str:
    parsed = parse_annotation(annotation, owner.names)
    return parsed.type if parsed is not None else "unknown"


def _frame_numbers(source: Source) -> Iterator[Finding]:
    for line, number in sorted({*_numbers_in_frames(source)}):
        here = source.comments.get(line, "") + source.comments.get(line - 1, "")
        if not _SECTION.search(here):
            yield source.finding(
                "drv010",
                line,
                f"{number} stands bare in a frame",
                "name it as a constant, or add a comment with the manual's section",
            )


def _numbers_in_frames(source: Source) -> Iterator[tuple[int, str]]:
    for method in source.find(ast.FunctionDef, ast.AsyncFunctionDef):
        if method.name.startswith("encode_"):
            yield from _bare_numbers(method)
    for call in source.find(ast.Call):
        if last_name(call) in _SENDERS:
            for argument in call.args:
                yield from _bare_numbers(argument)


def _bare_numbers(root: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(root):
        if not isinstance(node, ast.Constant) or type(node.value) not in {int, float}:
            continue
        if node.value not in _PLAIN_NUMBERS:
            yield node.lineno, repr(node.value)[:40]


def _marked(driver: DriverClass) -> list[Function]:
    return [*driver.actions.values(), *driver.statuses.values()]
