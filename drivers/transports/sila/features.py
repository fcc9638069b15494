"""What a feature of a SiLA 2 server is, as plain data, read from its definition.

Source:
    SiLA 2, part (A) 1.1, section "Feature Definition Language", and its schemas FeatureDefinition,
    DataTypes and Constraints; part (B) 1.1, "Mapping of features to protocol buffers".
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree

from labweb.domain.errors import FrameError

NAMESPACE = "{http://www.sila-standard.org}"
CORE = "org.silastandard/core/SiLAService/v1"
BASICS = frozenset({"Real", "Integer", "Boolean", "String"})
LONGEST_DEFINITION = 1_000_000
_WORD = re.compile(r"[A-Z][A-Za-z0-9]{0,255}")
_OWNER = re.compile(r"[a-z][a-z0-9.]{0,255}")


@dataclass(frozen=True, slots=True)
class UnitConversion:
    """How a number is turned into SI units: times the factor, plus the offset."""

    label: str
    factor: float
    offset: float
    components: tuple[tuple[str, int], ...]
    """SI unit and exponent."""


@dataclass(frozen=True, slots=True)
class Value:
    """A parameter, a response or a property."""

    name: str
    basic: str
    """`Real`, `Integer`, `Boolean`, `String`; "" for what is no plain value."""

    unit: UnitConversion | None = None
    low: float | None = None
    high: float | None = None
    """Smallest and largest number that is inside; what the definition leaves out is not."""

    doc: str = ""


@dataclass(frozen=True, slots=True)
class FeatureCommand:
    """Something that a server does."""

    name: str
    is_observable: bool
    parameters: tuple[Value, ...] = ()
    responses: tuple[Value, ...] = ()
    errors: tuple[str, ...] = ()
    doc: str = ""


@dataclass(frozen=True, slots=True)
class FeatureProperty:
    """Something that a server tells."""

    value: Value
    is_observable: bool


@dataclass(frozen=True, slots=True)
class Feature:
    """One feature."""

    id: str
    """Fully qualified: `org.silastandard/examples/TemperatureController/v1`."""

    name: str
    doc: str = ""
    commands: Mapping[str, FeatureCommand] = field(default_factory=dict)
    properties: Mapping[str, FeatureProperty] = field(default_factory=dict)

    @property
    def service(self) -> str:
        """Return the name of its gRPC service.

        Example:
            >>> Feature("org.silastandard/core/SiLAService/v1", "SiLAService").service
            'sila2.org.silastandard.core.silaservice.v1.SiLAService'
        """
        owner, category, name, version = self.id.split("/")
        return f"sila2.{owner}.{category}.{name.lower()}.{version}.{name}"


_ID = Value("FeatureIdentifier", "String")
SERVICE = Feature(
    CORE,
    "SiLAService",
    commands={
        "GetFeatureDefinition": FeatureCommand(
            "GetFeatureDefinition",
            is_observable=False,
            parameters=(_ID,),
            responses=(Value("FeatureDefinition", "String"),),
        )
    },
    properties={
        name: FeatureProperty(Value(name, "String"), is_observable=False)
        for name in ("ServerName", "ServerType", "ServerUUID", "ServerVersion", "ServerVendorURL")
    },
)
"""What every server has to have; `ImplementedFeatures`, a list, is asked for by its own name."""


def parse_feature(text: str) -> Feature:
    """Read a feature definition.

    Raises:
        FrameError: It is none, or too long.
    """
    if len(text) > LONGEST_DEFINITION or "<!DOCTYPE" in text:
        raise FrameError("a feature definition is too long, or declares entities")
    try:
        root = ElementTree.fromstring(text)  # noqa: S314 - it declares no entities
        return _feature(root)
    except (ElementTree.ParseError, ValueError, KeyError) as error:
        raise FrameError(f"a feature definition cannot be read: {error}") from error


def _feature(root: ElementTree.Element) -> Feature:
    name = _name(root)
    owner, category = root.attrib["Originator"], root.attrib.get("Category", "none")
    version = root.attrib["FeatureVersion"].partition(".")[0]
    if not (_OWNER.fullmatch(owner) and _OWNER.fullmatch(category) and version.isdigit()):
        raise ValueError(f"{owner}/{category}/{name}/v{version} is no identifier")
    commands = [_command(one) for one in root.findall(f"{NAMESPACE}Command")]
    properties = [_property(one) for one in root.findall(f"{NAMESPACE}Property")]
    return Feature(
        f"{owner}/{category}/{name}/v{version}",
        name,
        _text(root, "Description"),
        {one.name: one for one in commands},
        {one.value.name: one for one in properties},
    )


def _command(node: ElementTree.Element) -> FeatureCommand:
    errors = node.find(f"{NAMESPACE}DefinedExecutionErrors")
    return FeatureCommand(
        _name(node),
        _text(node, "Observable") == "Yes",
        tuple(_value(one) for one in node.findall(f"{NAMESPACE}Parameter")),
        tuple(_value(one) for one in node.findall(f"{NAMESPACE}Response")),
        tuple(one.text or "" for one in errors) if errors is not None else (),
        _text(node, "Description"),
    )


def _property(node: ElementTree.Element) -> FeatureProperty:
    return FeatureProperty(_value(node), _text(node, "Observable") == "Yes")


def _value(node: ElementTree.Element) -> Value:
    sort = node.find(f"{NAMESPACE}DataType")
    constrained = None if sort is None else sort.find(f"{NAMESPACE}Constrained")
    limits = None
    if constrained is not None:
        sort = constrained.find(f"{NAMESPACE}DataType")
        limits = constrained.find(f"{NAMESPACE}Constraints")
    basic = "" if sort is None else _text(sort, "Basic")
    return Value(
        _name(node),
        basic if basic in BASICS else "",
        None if limits is None else _unit(limits.find(f"{NAMESPACE}Unit")),
        *_range(limits),
        doc=_text(node, "Description"),
    )


def _range(limits: ElementTree.Element | None) -> tuple[float | None, float | None]:
    def bound(end: str, inward: float) -> float | None:
        if limits is None:
            return None
        if text := _text(limits, f"{end}Inclusive"):
            return float(text)
        text = _text(limits, f"{end}Exclusive")
        return math.nextafter(float(text), inward) if text else None

    return bound("Minimal", math.inf), bound("Maximal", -math.inf)


def _unit(node: ElementTree.Element | None) -> UnitConversion | None:
    if node is None:
        return None
    components = tuple(
        (_text(one, "SIUnit"), int(_text(one, "Exponent")))
        for one in node.findall(f"{NAMESPACE}UnitComponent")
    )
    factor, offset = float(_text(node, "Factor")), float(_text(node, "Offset"))
    return UnitConversion(_text(node, "Label"), factor, offset, components)


def _name(node: ElementTree.Element) -> str:
    name = _text(node, "Identifier")
    if not _WORD.fullmatch(name):
        raise ValueError(f"{name!r} is no identifier")
    return name


def _text(node: ElementTree.Element, name: str) -> str:
    found = node.find(f"{NAMESPACE}{name}")
    return " ".join((found.text or "").split()) if found is not None else ""
