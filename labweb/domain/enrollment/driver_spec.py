"""What a driver declares: its actions, statuses and settings, as plain data."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from typing import Any, Literal, TypeGuard

import msgspec

from labweb.domain.errors import Finding, NotFoundError

JsonType = Literal["number", "integer", "boolean", "string", "array", "object", "null"]
Recovery = Literal["R0", "R1", "R2", "R3"]
Operation = Literal["read", "update", "transfer"]
Quality = Literal["", "bronze", "silver", "gold"]

UNITS: Mapping[str, tuple[str, str]] = {
    "ul": ("volume", "µL"),
    "nl": ("volume", "nL"),
    "ul_s": ("flow_rate", "µL/s"),
    "mm": ("length", "mm"),
    "mm_s": ("linear_speed", "mm/s"),
    "deg": ("angle", "°"),
    "s": ("time", "s"),
    "c": ("temperature", "°C"),
    "mg": ("mass", "mg"),
    "ug": ("mass", "µg"),
    "umol": ("amount", "µmol"),
    "mmol_l": ("concentration", "mmol/L"),
    "mol_l": ("concentration", "mol/L"),
    "kg_m3": ("density", "kg/m³"),
    "ppm": ("fraction", "ppm"),
    "ph": ("ph", "pH"),
    "kpa": ("pressure", "kPa"),
    "rpm": ("speed", "rpm"),
    "g": ("acceleration", "×g"),
    "v": ("voltage", "V"),
    "ma": ("current", "mA"),
    "v_s": ("scan_rate", "V/s"),
    "hz": ("frequency", "Hz"),
    "nm": ("wavelength", "nm"),
    "us_cm": ("conductivity", "µS/cm"),
    "ncm": ("torque", "N·cm"),
    "n": ("force", "N"),
    "k_min": ("heating_rate", "K/min"),
    "ratio": ("ratio", ""),
    "count": ("count", ""),
    "index": ("index", ""),
}
"""Suffix of a name that carries a number → (quantity, symbol). The list is closed."""

_PYTHON_TYPES: Mapping[str, tuple[type, ...]] = {
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "string": (str,),
    "array": (list, tuple),
    "object": (dict,),
    "null": (type(None),),
}

_A_TYPE = {name: f"an {name}" if name[0] in "aeio" else f"a {name}" for name in _PYTHON_TYPES}


def unit_suffix(name: str) -> str:
    """Return the unit suffix a name ends in, or "" when it carries none.

    Example:
        >>> unit_suffix("rate_ul_s"), unit_suffix("volume")
        ('ul_s', '')
    """
    parts = name.split("_")
    for count in (2, 1):
        suffix = "_".join(parts[-count:])
        if len(parts) > count and suffix in UNITS:
            return suffix
    return ""


class AccuracySpec(msgspec.Struct, frozen=True, kw_only=True):
    """What a maker states of a number that can be calibrated; both None: nothing."""

    ratio: float | None = None
    """Share of the value."""

    absolute: float | None = None
    """In the unit of the name."""


class ParameterSpec(msgspec.Struct, frozen=True, kw_only=True):
    """One argument of an action, one setting of a driver, or one told value."""

    name: str
    type: JsonType | None = None
    """None: the source does not say."""

    nullable: bool = False
    unit: str = ""
    """Suffix of the closed list, "" when the value is not a number with a unit."""

    quantity: str = ""
    label: str = ""
    doc: str = ""
    required: bool = True
    default: Any = None
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[Any, ...] = ()
    accuracy: AccuracySpec | None = None
    """None: it cannot be calibrated."""

    @property
    def symbol(self) -> str:
        """Return the unit as a person reads and writes it; a difference of °C is in K."""
        if self.quantity == "temperature_difference":
            return "K"
        return UNITS[self.unit][1] if self.unit in UNITS else ""

    def schema(self) -> dict[str, Any]:
        """Render as JSON Schema 2020-12, with `x-quantity`, `x-unit` and `x-label`."""
        schema: dict[str, Any] = {"x-label": self.label or self.name}
        if self.type is not None:
            schema["type"] = [self.type, "null"] if self.nullable else self.type
        if self.choices:
            schema["enum"] = [*self.choices, None] if self.nullable else list(self.choices)
        optional = {
            "description": self.doc,
            "x-quantity": self.quantity,
            "x-unit": self.symbol,
        }
        schema.update({key: value for key, value in optional.items() if value})
        bounds = {"minimum": self.minimum, "maximum": self.maximum}
        schema.update({key: value for key, value in bounds.items() if value is not None})
        if not self.required:
            schema["default"] = self.default
        return schema


class ActionSpec(msgspec.Struct, frozen=True, kw_only=True):
    """One thing a device does."""

    name: str
    parameters: tuple[ParameterSpec, ...] = ()
    doc: str = ""
    timeout_s: float | None = None
    """Longest time the action may take. None: the source does not say."""

    recovery: Recovery = "R3"
    """How an unknown outcome is cleared: R0 ask by id, R1 repeat, R2 measure, R3 a person."""

    hazards: tuple[str, ...] = ()
    operation: Operation = "update"
    """What it does to the record: read, update a device, or move matter."""

    is_async: bool = False
    """The source writes it as `async def`. No line runs such an action: DRV012 refuses it."""

    role: str = ""
    """Interface that declares it (`pump`, `valve`); "" when no interface does."""

    def schema(self) -> dict[str, Any]:
        """Render the arguments as JSON Schema 2020-12."""
        return _object_schema(self.name, self.doc, self.parameters)


class StatusSpec(msgspec.Struct, frozen=True, kw_only=True):
    """One thing a device tells."""

    name: str
    value: ParameterSpec
    doc: str = ""
    every_s: float | None = None
    """How often to ask. None: the source does not say."""

    role: str = ""


class DriverSpec(msgspec.Struct, frozen=True, kw_only=True):
    """All that planning and dispatch need to know about a driver; never its code."""

    version: int = 1
    class_name: str
    module: str
    """Dotted name, `drivers.connectors.tricontinent_c3000`; "" for a file outside the package."""

    digest: str
    """SHA-256 of the bundle, lower-case hex: what an approval signs. Of a file outside the
    package, that of the file."""

    roles: tuple[str, ...] = ()
    """Interfaces the class declares, `pump`, `valve`, in the order it names them."""

    transport: str = ""
    """Sort of carrier it speaks through: `byte`, `register`, `http`, `opcua`, `ros2`, `s7`, `sila`
    or `virtual`."""

    doc: str = ""
    protocol: str = ""
    """The module's `Protocol:` line."""

    quality: Quality = ""
    quality_note: str = ""
    safe_state: str = ""
    """The module's `Safe state:` line: what `stop()` leaves behind."""

    actions: tuple[ActionSpec, ...] = ()
    statuses: tuple[StatusSpec, ...] = ()
    config: tuple[ParameterSpec, ...] = ()
    imports: tuple[str, ...] = ()
    """Modules the source names in its imports, for the reviewer."""

    findings: tuple[Finding, ...] = ()
    """What breaks the conformance rules; empty means clean."""

    @property
    def role(self) -> str:
        """Return the first interface, or "" for a plain class."""
        return self.roles[0] if self.roles else ""

    def action(self, name: str) -> ActionSpec:
        """Find an action by name.

        Raises:
            NotFoundError: The driver has no such action; `context` lists those it has.
        """
        for action in self.actions:
            if action.name == name:
                return action
        raise NotFoundError(
            f"{self.class_name} has no action {name!r}",
            code="driver.no_action",
            context={"actions": [action.name for action in self.actions]},
        )

    def status(self, name: str) -> StatusSpec:
        """Find a status by name.

        Raises:
            NotFoundError: The driver has no such status; `context` lists those it has.
        """
        for status in self.statuses:
            if status.name == name:
                return status
        raise NotFoundError(
            f"{self.class_name} has no status {name!r}",
            code="driver.no_status",
            context={"statuses": [status.name for status in self.statuses]},
        )

    def config_schema(self) -> dict[str, Any]:
        """Render the settings as JSON Schema 2020-12."""
        return _object_schema(self.class_name, self.doc, self.config)


def check_arguments(action: ActionSpec, arguments: Mapping[str, Any]) -> list[Finding]:
    """List every way in which the arguments do not fit the action; empty means go."""
    return _check_values(action.name, action.parameters, arguments)


def check_config(spec: DriverSpec, config: Mapping[str, Any]) -> list[Finding]:
    """List every way in which the settings do not fit the driver; empty means go."""
    findings = _check_values(spec.class_name, spec.config, config)
    return findings or list(_check_limits(spec, config))


def _check_limits(spec: DriverSpec, config: Mapping[str, Any]) -> Iterator[Finding]:
    """Refuse limits that cross: a smallest value above the largest, set or by default."""
    known = {one.name: one.default for one in spec.config if not one.required} | dict(config)
    for name, low in known.items():
        high = known.get(f"max_{name.removeprefix('min_')}") if name.startswith("min_") else None
        if _is_number(low) and _is_number(high) and low > high:
            text = f"{spec.class_name}: {name} {low} is above max_{name[4:]} {high}"
            yield _finding("range", spec.class_name, name, text)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def check_reading(told: ParameterSpec, value: object) -> list[Finding]:
    """List why a value that a device told is none that its driver declares; empty means it is."""
    return _check_value("the device", told, value)


def encode(spec: DriverSpec) -> bytes:
    """Render as canonical JSON."""
    return msgspec.json.encode(spec, order="sorted")


def parse(data: bytes | str) -> DriverSpec:
    """Read a spec from JSON.

    Raises:
        msgspec.ValidationError: The JSON is not a `DriverSpec`.
    """
    return msgspec.json.decode(data, type=DriverSpec)


def _object_schema(title: str, doc: str, parameters: tuple[ParameterSpec, ...]) -> dict[str, Any]:
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "description": doc,
        "type": "object",
        "properties": {parameter.name: parameter.schema() for parameter in parameters},
        "required": [parameter.name for parameter in parameters if parameter.required],
        "additionalProperties": False,
    }


def _check_values(
    owner: str, parameters: tuple[ParameterSpec, ...], values: Mapping[str, Any]
) -> list[Finding]:
    known = {parameter.name: parameter for parameter in parameters}
    findings = [
        _finding("unknown", owner, name, f"{owner} takes no {name!r}")
        for name in values
        if name not in known
    ]
    for name, parameter in known.items():
        if name in values:
            findings.extend(_check_value(owner, parameter, values[name]))
        elif parameter.required:
            findings.append(_finding("missing", owner, name, f"{owner} needs {name!r}"))
    return findings


def _check_value(owner: str, parameter: ParameterSpec, value: object) -> list[Finding]:
    if value is None and parameter.nullable:
        return []
    problem = (
        _type_problem(parameter, value)
        or _choice_problem(parameter, value)
        or _range_problem(parameter, value)
    )
    if not problem:
        return []
    code, text = problem
    return [_finding(code, owner, parameter.name, f"{owner}: {parameter.name} {text}")]


def _type_problem(parameter: ParameterSpec, value: object) -> tuple[str, str] | None:
    if parameter.type is None:
        return None
    is_bool = isinstance(value, bool)
    fits = isinstance(value, _PYTHON_TYPES[parameter.type])
    if not fits or (is_bool and parameter.type != "boolean"):
        return "type", f"is {_A_TYPE[parameter.type]}; got {value!r:.80}"
    if isinstance(value, float) and not math.isfinite(value):
        return "type", f"is a finite number; got {value!r}"
    return None


def _choice_problem(parameter: ParameterSpec, value: object) -> tuple[str, str] | None:
    if parameter.choices and value not in parameter.choices:
        return "choice", f"is one of {list(parameter.choices)}; got {value!r:.80}"
    return None


def _range_problem(parameter: ParameterSpec, value: object) -> tuple[str, str] | None:
    if not isinstance(value, int | float):
        return None
    if parameter.minimum is not None and value < parameter.minimum:
        return "range", f"is at least {_amount(parameter, parameter.minimum)}; got {_plain(value)}"
    if parameter.maximum is not None and value > parameter.maximum:
        return "range", f"is at most {_amount(parameter, parameter.maximum)}; got {_plain(value)}"
    return None


def _amount(parameter: ParameterSpec, value: float) -> str:
    return f"{_plain(value)} {parameter.symbol}".rstrip()


def _plain(value: float) -> str:
    """Write a number; an integer may be larger than any float."""
    return f"{value:g}" if abs(value) <= sys.float_info.max else f"{str(value)[:20]}…"


def _finding(reason: str, owner: str, name: str, message: str) -> Finding:
    return Finding(f"driver.argument_{reason}", message, subject=f"{owner}.{name}")
