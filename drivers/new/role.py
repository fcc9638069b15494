"""Reads a role: its actions and statuses as `drivers/interfaces` declares them."""

from __future__ import annotations

import ast
import inspect
from dataclasses import dataclass
from functools import cache

from drivers.catalog.annotations import Annotation, last_name, parse_annotation
from drivers.catalog.inspect import (
    PACKAGE,
    Function,
    Interface,
    arguments_of,
    known_interfaces,
)
from drivers.catalog.scan import scan
from drivers.catalog.source import read_source
from drivers.new.ranges_table import AT_FIRST, RANGES, TOLERANCE
from labweb.domain.enrollment.driver_spec import DriverSpec, Operation, unit_suffix
from labweb.domain.errors import DefinitionError

Span = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RoleArgument:
    """One argument of an action."""

    name: str
    annotation: str
    """As source text, with a range where it is a number."""

    span: Span | None
    """Lowest, highest and usual value; None: not a number."""

    choices: tuple[object, ...]
    sample: object
    """A value that the test uses; JSON-ready."""


@dataclass(frozen=True, slots=True)
class RoleAction:
    """One action."""

    name: str
    doc: str
    arguments: tuple[RoleArgument, ...]
    operation: Operation
    """`transfer` where the interface speaks of `moved_ul`, `read` where its effect is none."""

    hazards: tuple[str, ...]
    """What the drivers of this role in the package warn of."""

    @property
    def samples(self) -> dict[str, object]:
        """Arguments as the test gives them."""
        return {argument.name: argument.sample for argument in self.arguments}


@dataclass(frozen=True, slots=True)
class Tell:
    """One status."""

    name: str
    doc: str
    returns: str
    """As source text."""

    at_first: object
    """What the simulated instrument tells before anything happened; JSON-ready."""


@dataclass(frozen=True, slots=True)
class DriverRole:
    """A role, and where drivers of it live."""

    name: str
    class_name: str
    module: str
    """Dotted name of its interface."""

    folders: tuple[str, ...]
    """Folders of the package that hold drivers of it; chiefly of it, where there are any."""

    acts: tuple[RoleAction, ...]
    tells: tuple[Tell, ...]

    @property
    def moves(self) -> bool:
        """Tell whether an action of it says how much it moved."""
        return any(act.operation == "transfer" for act in self.acts)

    @property
    def only_reads(self) -> bool:
        """Tell whether there is nothing to halt."""
        return all(act.operation == "read" for act in self.acts)


def role_names() -> list[str]:
    """List the roles that a driver can have."""
    return sorted(interface.role for interface in known_interfaces().values())


def read_role(name: str) -> DriverRole:
    """Read one role.

    Raises:
        DefinitionError: There is no such role, or a value of it has a unit without a range here.
    """
    face = next((one for one in known_interfaces().values() if one.role == name), None)
    if face is None:
        raise DefinitionError(
            f"there is no role {name!r}: choose one of {', '.join(role_names())}",
            code="driver.new",
        )
    peers = [spec for spec in _drivers() if name in spec.roles]
    chiefly = [spec for spec in peers if spec.roles[0] == name] or peers
    acts = [one for one in face.methods.values() if last_name(one.returns) == "Report"]
    tells = [one for one in face.methods.values() if one not in acts]
    return DriverRole(
        name=name,
        class_name=face.name,
        module=_module_of(face.name),
        folders=tuple(sorted({spec.module.split(".")[1] for spec in chiefly})),
        acts=tuple(_act(face, method, peers) for method in acts),
        tells=tuple(_tell(face, method) for method in tells),
    )


@cache
def _drivers() -> tuple[DriverSpec, ...]:
    return scan(PACKAGE).drivers


def _module_of(class_name: str) -> str:
    for path in sorted((PACKAGE / "interfaces").glob("[!_]*.py")):
        nodes = read_source(path).tree.body
        if any(isinstance(node, ast.ClassDef) and node.name == class_name for node in nodes):
            return f"drivers.interfaces.{path.stem}"
    raise DefinitionError(f"no file of drivers/interfaces declares {class_name}")


def _act(face: Interface, method: Function, peers: list[DriverSpec]) -> RoleAction:
    doc = inspect.cleandoc(ast.get_docstring(method) or "")
    effect = doc.partition("Effect:")[2].strip()
    hazards = {
        hazard
        for spec in peers
        for action in spec.actions
        if action.name == method.name and action.role == face.role
        for hazard in action.hazards
    }
    operation: Operation = "transfer" if "`moved_ul`" in effect else "update"
    return RoleAction(
        name=method.name,
        doc=doc,
        arguments=tuple(_argument(face, argument) for argument, _ in arguments_of(method)),
        operation="read" if effect == "None." else operation,
        hazards=tuple(sorted(hazards)),
    )


def _tell(face: Interface, method: Function) -> Tell:
    found = _parsed(face, method.name, method.returns)
    return Tell(
        name=method.name,
        doc=inspect.cleandoc(ast.get_docstring(method) or ""),
        returns=ast.unparse(method.returns) if method.returns is not None else "",
        at_first=_at_first(method.name, found),
    )


def _argument(face: Interface, argument: ast.arg) -> RoleArgument:
    found = _parsed(face, argument.arg, argument.annotation)
    text = ast.unparse(argument.annotation) if argument.annotation is not None else ""
    if found.choices or found.type not in {"number", "integer"}:
        sample = found.choices[-1] if found.choices else _plain(found)
        return RoleArgument(argument.arg, text, None, found.choices, sample)
    low, high, usual = _span(argument.arg)
    if found.type == "integer":
        shown, sample = f"Range({int(low)}, {int(high)})", int(usual)
    else:
        shown, sample = f"Range({low}, {high})", usual
    if argument.arg == "tolerance_c":
        shown += ', Quantity("temperature_difference")'
    return RoleArgument(argument.arg, f"Annotated[{text}, {shown}]", (low, high, usual), (), sample)


def _parsed(face: Interface, name: str, annotation: ast.expr | None) -> Annotation:
    found = parse_annotation(annotation, face.names)
    if found is None:
        raise DefinitionError(f"{face.name}: {name} has no type that JSON carries")
    return found


def _span(name: str) -> Span:
    return TOLERANCE if name.startswith("tolerance_") else RANGES[unit_suffix(name)]


def _at_first(name: str, found: Annotation) -> object:
    if found.choices:
        return found.choices[0]
    if found.type == "number":
        return AT_FIRST.get(unit_suffix(name), 0.0)
    if found.type == "integer":
        return int(AT_FIRST.get(unit_suffix(name), 0.0))
    return _plain(found)


def _plain(found: Annotation) -> object:
    values: dict[str, object] = {"string": "idle", "boolean": False, "array": [], "object": {}}
    return values[found.type]
