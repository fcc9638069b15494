"""Write down what a device offers over OPC UA, as a spec.

Source:
    OPC 10000-5 (data types), OPC 10000-8, 5.6.4.3 (units by UN/CEFACT code), OPC 30500-1, 7.6
    (the argument of StartWithTargetValue is a value of the function's TargetValue).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.browse.browsed import Browsed, NodeBinding, sealed, snake
from drivers.transports.opcua.nodes import MethodArgument, Node, NodeName, Variable
from drivers.transports.opcua.transport import OpcUaTransport
from labweb.domain.enrollment.driver_spec import (
    UNITS,
    ActionSpec,
    DriverSpec,
    JsonType,
    ParameterSpec,
    StatusSpec,
)
from labweb.domain.errors import DefinitionError, Finding, NotFoundError

UA = "http://opcfoundation.org/UA/"
LADS = "http://opcfoundation.org/UA/LADS/"
PROPERTY = NodeName(UA, "i=68")
MOST_NODES = 5000
MOST_LEVELS = 16
SETS = frozenset({"FunctionalUnitSet", "FunctionSet", "ParameterSet", "MethodSet"})
"""Folders that tell nothing: they are left out of names."""

TYPES: Mapping[str, JsonType] = {
    "i=1": "boolean",
    **dict.fromkeys(("i=2", "i=3", "i=4", "i=5", "i=6", "i=7", "i=8", "i=9"), "integer"),
    **dict.fromkeys(("i=27", "i=28", "i=29"), "integer"),
    **dict.fromkeys(("i=10", "i=11", "i=26", "i=290"), "number"),
    **dict.fromkeys(("i=12", "i=17", "i=21"), "string"),
}
"""Data types of namespace 0 that are one plain value."""

FACTORS: Mapping[str, tuple[str, float]] = {
    "CEL": ("c", 1.0),
    "RPM": ("rpm", 1.0),
    "HTZ": ("hz", 1.0),
    "VLT": ("v", 1.0),
    "4K": ("ma", 1.0),
    "AMP": ("ma", 1e3),
    "SEC": ("s", 1.0),
    "MIN": ("s", 60.0),
    "HUR": ("s", 3600.0),
    "KPA": ("kpa", 1.0),
    "PAL": ("kpa", 1e-3),
    "MBR": ("kpa", 0.1),
    "BAR": ("kpa", 100.0),
    "4G": ("ul", 1.0),
    "MLT": ("ul", 1e3),
    "LTR": ("ul", 1e6),
    "MC": ("ug", 1.0),
    "MGM": ("mg", 1.0),
    "GRM": ("mg", 1e3),
    "KGM": ("mg", 1e6),
    "MMT": ("mm", 1.0),
    "CMT": ("mm", 10.0),
    "MTR": ("mm", 1e3),
    "DD": ("deg", 1.0),
    "P1": ("ratio", 0.01),
    "C62": ("ratio", 1.0),
}
"""UN/CEFACT code → our unit, and by what the server's number is multiplied."""


@dataclass
class _Walk:
    """Collects while it goes from node to node."""

    transport: OpcUaTransport
    statuses: list[StatusSpec] = field(default_factory=list)
    actions: list[ActionSpec] = field(default_factory=list)
    bindings: dict[str, NodeBinding] = field(default_factory=dict)
    plate: dict[str, str] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    seen: set[NodeName] = field(default_factory=set)
    targets: dict[tuple[str, ...], Variable] = field(default_factory=dict)
    """TargetValue of each LADS function, by its way."""

    def visit(self, node: Node, way: tuple[str, ...]) -> None:
        """Look at all below a node."""
        if len(way) > MOST_LEVELS or len(self.seen) > MOST_NODES:
            message = f"more than {MOST_LEVELS} levels or {MOST_NODES} nodes; browse a part of it"
            self.findings.append(Finding("browse.too_many", message, "/".join(way)))
            return
        # A function's variables come before its state machine, whose methods refer to them.
        children = sorted(self.transport.children(node.id), key=lambda one: one.kind != "variable")
        for child in children:
            if child.id in self.seen:
                continue
            self.seen.add(child.id)
            further = (*way, child.name)
            if child.kind == "method":
                self._add_method(node, child, further)
            elif child.kind == "variable" and child.type == PROPERTY:
                self._note(child)
            elif child.kind == "variable":
                self._add_variable(child, further)
            elif child.kind == "object":
                self.visit(child, further)

    def _note(self, node: Node) -> None:
        """Keep what stands on the type plate."""
        if node.name in {"Manufacturer", "Model", "SerialNumber"} and node.name not in self.plate:
            self.plate[node.name] = str(self.transport.read(node.id, node.name))

    def _add_variable(self, node: Node, way: tuple[str, ...]) -> None:
        told = self.transport.variable(node.id)
        if node.name == "TargetValue" and node.name_uri == LADS:
            self.targets[way[:-1]] = told
        sort = self._sort(told.data_type, told.rank, way)
        if sort is None:
            return
        value = self._value(_snake(way), sort, told, way)
        if value is None or not self._is_free(value.name, way):
            return
        factor = _factor(told)
        if told.is_readable:
            doc = told.doc or f"Tell {'/'.join(way)}."
            self.statuses.append(StatusSpec(name=value.name, value=value, doc=doc))
            self.bindings[value.name] = NodeBinding(node=str(node.id), factor=factor)
        if told.is_writable:
            self._add_setter(node, value, factor, way)

    def _add_setter(
        self, node: Node, value: ParameterSpec, factor: float, way: tuple[str, ...]
    ) -> None:
        if value.type in {"number", "integer"} and (value.minimum is None or value.maximum is None):
            message = (
                f"{value.name} may be written, but the server tells no range: no action is made"
            )
            self.findings.append(Finding("browse.range", message, "/".join(way)))
            return
        name = f"set_{value.name}"
        doc = f"Write {'/'.join(way)}."
        self.actions.append(ActionSpec(name=name, parameters=(value,), doc=doc, recovery="R1"))
        self.bindings[name] = NodeBinding(node=str(node.id), factor=factor)

    def _add_method(self, owner: Node, node: Node, way: tuple[str, ...]) -> None:
        told = self.transport.method(node.id)
        name = _snake(way)
        found = [self._argument(owner, node, one, way) for one in told.inputs]
        parameters = tuple(one for one, _ in (pair for pair in found if pair is not None))
        if len(parameters) < len(found) or not self._is_free(name, way):
            return
        factors = {factor for pair in found if pair is not None for factor in pair[1:]}
        if not told.is_executable or len(factors) > 1:
            message = f"{name} cannot be called as it is: not executable, or units that differ"
            self.findings.append(Finding("browse.argument", message, "/".join(way)))
            return
        doc = told.doc or f"Call {'/'.join(way)}."
        self.actions.append(ActionSpec(name=name, parameters=parameters, doc=doc))
        self.bindings[name] = NodeBinding(
            node=str(node.id), owner=str(owner.id), factor=factors.pop() if factors else 1.0
        )

    def _argument(
        self, owner: Node, method: Node, one: MethodArgument, way: tuple[str, ...]
    ) -> tuple[ParameterSpec, float] | None:
        """Map an argument; numbers have no unit of their own in OPC UA."""
        sort = self._sort(one.data_type, one.rank, (*way, one.name))
        if sort is None:
            return None
        name = _snake((one.name,))
        if sort in {"boolean", "string"}:
            return ParameterSpec(name=name, type=sort, doc=one.doc), 1.0
        told = self._target(way) if method.name_uri == LADS and one.name == "TargetValue" else None
        if told is None:
            message = (
                f"argument {one.name} of {method.name} is a number, and no standard says its unit"
            )
            subject = f"{owner.name}/{method.name}/{one.name}"
            self.findings.append(Finding("browse.argument", message, subject))
            return None
        value = self._value(name, "number", told, (*way, one.name))
        return None if value is None else (value, _factor(told))

    def _target(self, way: tuple[str, ...]) -> Variable | None:
        """Return the TargetValue of the function that a LADS state machine belongs to."""
        return self.targets.get(way[:-2])

    def _sort(self, data_type: NodeName, rank: int, way: tuple[str, ...]) -> JsonType | None:
        sort = TYPES.get(data_type.key) if data_type.uri == UA else None
        if sort is None:
            message = f"data type {data_type} is no plain value"
            self.findings.append(Finding("browse.type", message, "/".join(way)))
        elif rank != -1:
            sort = None
            message = f"value rank {rank}: an array is not mapped"
            self.findings.append(Finding("browse.rank", message, "/".join(way)))
        return sort

    def _value(
        self, name: str, sort: JsonType, told: Variable, way: tuple[str, ...]
    ) -> ParameterSpec | None:
        if sort not in {"number", "integer"}:
            return ParameterSpec(name=name, type=sort, doc=told.doc)
        code = told.unit.code if told.unit is not None else ""
        if code not in FACTORS:
            symbol = "" if told.unit is None else f" ({told.unit.symbol})"
            message = f"unit {code or 'none'}{symbol} is not among {', '.join(FACTORS)}"
            self.findings.append(Finding("browse.unit", message, "/".join(way)))
            return None
        unit, factor = FACTORS[code]
        return ParameterSpec(
            name=f"{name}_{unit}",
            type="number",
            unit=unit,
            quantity=UNITS[unit][0],
            doc=told.doc,
            minimum=None if told.low is None else told.low * factor,
            maximum=None if told.high is None else told.high * factor,
        )

    def _is_free(self, name: str, way: tuple[str, ...]) -> bool:
        if name not in self.bindings and name.isidentifier():
            return True
        message = f"the name {name!r} is taken or cannot be written in Python"
        self.findings.append(Finding("browse.name", message, "/".join(way)))
        return False


def _snake(way: tuple[str, ...]) -> str:
    """Make a name of a way.

    Example:
        >>> _snake(("FunctionalUnitSet", "Unit 1", "FunctionSet", "BlockTemperature"))
        'unit_1_block_temperature'
    """
    return snake(way, without=SETS)


def _factor(told: Variable) -> float:
    return 1.0 if told.unit is None else FACTORS.get(told.unit.code, ("", 1.0))[1]


def find_device(transport: OpcUaTransport, way: tuple[str, ...]) -> Node:
    """Find an object by browse names, from the folder of all objects on.

    Raises:
        NotFoundError: No such name, or several; `context["names"]` lists those there are.
        DeviceError: The server does not answer, or answers badly.
    """
    found: Node | None = None
    for name in way:
        children = transport.children(None if found is None else found.id)
        fitting = [one for one in children if one.name == name and one.kind == "object"]
        if len(fitting) != 1:
            raise NotFoundError(
                f"{len(fitting)} objects are named {name!r} there; one is needed",
                code="browse.not_found",
                context={"names": sorted(one.name for one in children)},
            )
        found = fitting[0]
    if found is None:
        raise DefinitionError("name the device: DeviceSet/Controller", code="browse.no_name")
    return found


def browse(transport: OpcUaTransport, way: tuple[str, ...]) -> Browsed:
    """Write down what a device offers; the line has to be open.

    Readable variables become statuses, writable ones with a range actions that set them, and
    methods whose arguments are known become actions. Limits are in our units.

    Args:
        transport: An open line to the server.
        way: Browse names from the folder of all objects to the device.

    Raises:
        NotFoundError: The device is not there.
        DeviceError: The server does not answer, or answers badly.

    Effect:
        None: nothing is written and nothing is called.
    """
    device = find_device(transport, way)
    walk = _Walk(transport)
    walk.visit(device, ())
    text = [
        walk.plate[name] for name in ("Manufacturer", "Model", "SerialNumber") if name in walk.plate
    ]
    spec = DriverSpec(
        class_name="".join(word.capitalize() for word in _snake((device.name,)).split("_")),
        module="",
        digest="",
        transport=transport.sort,
        doc=" ".join(text),
        protocol=f"OPC UA, browsed at {'/'.join(way)}",
        actions=tuple(walk.actions),
        statuses=tuple(walk.statuses),
        findings=tuple(walk.findings),
    )
    return sealed(spec, walk.bindings)
