"""Binding files: which kind a foreign class is, and which nodes make up a device.

A binding is data. Its rules speak of classes, links and fields, never of names of nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta

from labweb.domain.errors import Finding, LabFileError
from labweb.domain.graph.lab_file.untrusted_json import decode_json, refuse, refuse_all
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.resource_kinds import KINDS

_LARGEST = 1e9
_T = TypeVar("_T")

SCHEMA = "labweb.binding/1"
"""Version of binding files that this package reads."""


class _Rule(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all rules."""


class ValueRule(_Rule, frozen=True, kw_only=True):
    """Where a value comes from: a field of a node, its tubes, or the binding itself."""

    value: Any = None
    """The value; `field` is then not used."""

    role: str | None = None
    """Node that has the field; not needed in a rule of one class."""

    field: str | list[str] | None = None
    """Path in the node as the foreign file has it, `config.max_volume`; of several the first
    that the node has."""

    tubes: bool = False
    """The largest number of a port of the node that a link leads to; then without `field`."""

    scale: Annotated[float, Meta(gt=0)] | None = None
    """Factor into our unit: 1000 from mL to µL. The field must then be a number."""

    form: Literal["any", "text", "whole", "number"] = "any"
    """What the field must be: text (a whole number is written as text), whole, number."""

    least: float | None = None
    most: float | None = None
    """Ends of what the instrument can do, for numbers; what is beyond is cut, with a note."""

    otherwise: Any = None
    """Value when the node has no such field; without it the rule does not apply."""

    def within(self, value: float) -> float:
        """Return the value, or the end of what the instrument can do where it is beyond."""
        low = -inf if self.least is None else self.least
        high = inf if self.most is None else self.most
        return max(low, min(high, value))

    @property
    def named(self) -> str:
        """Return the field, for sentences."""
        return self.field if isinstance(self.field, str) else " or ".join(self.field or ())


class ClassRule(_Rule, frozen=True, kw_only=True):
    """What a class is here."""

    kind: str
    config: dict[str, ValueRule] = msgspec.field(default_factory=dict)
    """Config of the resource; a value that the node lacks is left out."""


class JoinRule(_Rule, frozen=True, kw_only=True):
    """How the nodes of one device hang together."""

    by: Literal["link", "vessel", "node"]
    """`link`: the second role is linked to the first. `vessel`: both to one vessel. `node`: one
    node plays both."""

    media: list[Medium] = msgspec.field(default_factory=list)
    ports: dict[str, str] = msgspec.field(default_factory=dict)
    """Role → port at which its end of the link must be."""


class SelectorRule(_Rule, frozen=True, kw_only=True):
    """The node that selects ports: all but the common one are numbered from 1."""

    role: str
    common_port: str | None = None
    """None: the pump itself is behind all ports."""

    count: ValueRule


class SimulatorRule(_Rule, frozen=True, kw_only=True):
    """Simulated instrument of a device."""

    model: str
    settings: dict[str, ValueRule] = msgspec.field(default_factory=dict)


class DeviceRule(_Rule, frozen=True, kw_only=True):
    """Nodes of these classes, joined like this, are one device."""

    name: str
    driver: str
    roles: dict[str, list[str]]
    """Role in the driver → classes, as names or patterns with `*`; in order."""

    join: JoinRule | None = None
    selector: SelectorRule | None = None
    config: dict[str, ValueRule] = msgspec.field(default_factory=dict)
    simulator: SimulatorRule


class HostRule(_Rule, frozen=True, kw_only=True):
    """Host that gets the devices."""

    key: str
    name: str
    timers_count: Annotated[int, Meta(ge=0, le=16)] = 0
    """Timers of the host: they need no instrument, and a graph has none."""


class BindingFile(_Rule, frozen=True, kw_only=True):
    """A whole binding file."""

    schema: Literal["labweb.binding/1"]
    format: Literal["uni_lab_os", "chemputer"]
    about: str = ""
    host: HostRule
    tubes: list[str] = msgspec.field(default_factory=list)
    """Types of link that are a tube where both ends hold or conduct liquid, and else carry what
    the instrument at an end does: heat, stirring, vacuum."""

    unbound: dict[str, str] = msgspec.field(default_factory=dict)
    """Class, as a name or a pattern with `*` → why no device is made of it."""

    classes: dict[str, ClassRule]
    """Class, as a name or a pattern with `*` → what it is. An exact name goes first."""

    devices: list[DeviceRule]
    """Tried in order; a node that one rule was for is not offered to the next, even where it lacks
    something and no device is made."""

    def class_rule(self, name: object) -> ClassRule | None:
        """Return the rule of a class; None when nobody mapped it."""
        return _match(name, self.classes)

    def why_unbound(self, name: object) -> str | None:
        """Return why no device is made of a class; None when the binding does not say."""
        return _match(name, self.unbound)


def _match(name: object, rules: Mapping[str, _T]) -> _T | None:
    if not isinstance(name, str) or not name:
        return None
    if name in rules:
        return rules[name]
    return next((rule for pattern, rule in rules.items() if is_match(name, pattern)), None)


def is_match(name: object, pattern: str) -> bool:
    """Tell whether a class is meant by a pattern; a final `*` stands for any rest.

    Example:
        >>> is_match("pump.runze.SY03B", "pump.runze.*"), is_match("pump", "pump.*")
        (True, False)
    """
    if not isinstance(name, str) or not name:
        return False
    return name.startswith(pattern[:-1]) if pattern.endswith("*") else name == pattern


def read_binding(raw: bytes) -> BindingFile:
    """Read a binding file.

    Raises:
        LabFileError: It is no binding; the findings say where.
    """
    value = decode_json(raw)
    try:
        binding = msgspec.convert(value, BindingFile)
    except msgspec.ValidationError as error:
        raise refuse("binding.invalid", f"the binding is refused: {error}") from error
    findings = _check(binding)
    if findings:
        raise refuse_all(findings, "the binding")
    return binding


def _check(binding: BindingFile) -> list[Finding]:
    findings = [
        Finding("binding.unknown_kind", f"class {name!r}: kind {rule.kind!r} is unknown", name)
        for name, rule in binding.classes.items()
        if rule.kind not in KINDS
    ]
    for rule in binding.devices:
        roles = set(rule.roles)
        named = {value.role for value in _values(rule)} - {None}
        named |= set(rule.join.ports) if rule.join else set()
        named |= {rule.selector.role} if rule.selector else set()
        findings += [
            Finding("binding.unknown_role", f"{rule.name}: there is no role {role!r}", rule.name)
            for role in sorted(str(name) for name in named - roles)
        ]
        findings += _check_selector(rule)
        if (len(roles) > 1) != (rule.join is not None) or len(roles) > 2 or not roles:
            text = f"{rule.name}: one role without join, or two roles with one"
            findings.append(Finding("binding.roles", text, rule.name))
    return findings


def _check_selector(rule: DeviceRule) -> list[Finding]:
    count = None if rule.selector is None else rule.selector.count
    is_counted = count is None or count.tubes or count.form == "whole"
    if is_counted or (count is not None and type(count.value) is int):
        return []
    text = f"{rule.name}: the count of a selector has the form whole"
    return [Finding("binding.form", text, rule.name)]


def _values(rule: DeviceRule) -> list[ValueRule]:
    values = [*rule.config.values(), *rule.simulator.settings.values()]
    return [*values, rule.selector.count] if rule.selector else values


def find_value(rule: ValueRule, node: Mapping[str, Any]) -> Any:  # noqa: ANN401 - JSON
    """Return the value that a rule means for a node; None when there is none.

    Raises:
        LabFileError: The field is there, but not in the form that the rule wants.
    """
    if rule.field is None:
        return rule.value
    paths = [rule.field] if isinstance(rule.field, str) else rule.field
    # A form that nobody filled in, says nothing.
    found = next((one for path in paths if (one := _at(path, node)) not in (None, "")), None)
    if found is None:
        return rule.otherwise
    if rule.scale is None:
        return _formed(rule, found)
    if isinstance(found, bool) or not isinstance(found, int | float) or not 0 < found < _LARGEST:
        raise LabFileError(f"{rule.named} is {found!r}, no positive number", code="binding.value")
    scaled = found * rule.scale
    return int(scaled) if float(scaled).is_integer() else scaled


def _at(path: str, node: Mapping[str, Any]) -> Any:  # noqa: ANN401 - JSON
    found: Any = node
    for part in path.split("."):
        found = found.get(part) if isinstance(found, Mapping) else None
    return found


def _formed(rule: ValueRule, found: object) -> object:
    is_whole = isinstance(found, int) and not isinstance(found, bool)
    if rule.form == "text" and is_whole:
        return str(found)
    fits = {
        "any": True,
        "text": isinstance(found, str) and bool(found),
        "whole": is_whole,
        "number": is_whole or isinstance(found, float),
    }
    if rule.form == "number" and isinstance(found, str):
        return _decimal(rule, found)
    if not fits[rule.form]:
        raise LabFileError(f"{rule.named} is {found!r}, not {rule.form}", code="binding.value")
    return found


def _decimal(rule: ValueRule, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = inf
    if not isfinite(value):
        raise LabFileError(f"{rule.named} is {text!r}, not {rule.form}", code="binding.value")
    return value
