"""Write down what a feature of a SiLA 2 server offers, as a spec.

Source:
    SiLA 2, part (A) 1.1, "Unit constraint": SI value = number times factor plus offset.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.browse.browsed import Browsed, Collected, NodeBinding, snake
from drivers.transports.sila.features import CORE, Feature, FeatureCommand, UnitConversion, Value
from drivers.transports.sila.transport import SilaTransport
from labweb.domain.enrollment.driver_spec import (
    UNITS,
    ActionSpec,
    JsonType,
    ParameterSpec,
    StatusSpec,
)

SORTS: Mapping[str, JsonType] = {
    "Real": "number",
    "Integer": "number",
    "Boolean": "boolean",
    "String": "string",
}
ZERO_C_K = 273.15
SI: Mapping[tuple[tuple[str, int], ...], tuple[str, float, float]] = {
    (("Kelvin", 1),): ("c", 1.0, -ZERO_C_K),
    (("Second", 1),): ("s", 1.0, 0.0),
    (("Second", -1),): ("hz", 1.0, 0.0),
    (("Meter", 1),): ("mm", 1e3, 0.0),
    (("Meter", 3),): ("ul", 1e9, 0.0),
    (("Meter", 3), ("Second", -1)): ("ul_s", 1e9, 0.0),
    (("Kilogram", 1),): ("mg", 1e6, 0.0),
    (("Kilogram", 1), ("Meter", -1), ("Second", -2)): ("kpa", 1e-3, 0.0),
    (("Ampere", 1),): ("ma", 1e3, 0.0),
    (("Mole", 1),): ("umol", 1e6, 0.0),
    (("Dimensionless", 1),): ("ratio", 1.0, 0.0),
}
"""SI units and exponents → our unit, by what the SI value is multiplied, and what is added."""


def browse_feature(transport: SilaTransport, feature_id: str) -> Browsed:
    """Write down what a feature offers; the line has to be open.

    Properties become statuses, and commands whose parameters are known become actions.

    Raises:
        RejectedError: The server has no such feature; `context["features"]` lists those it has.
        DeviceError: It does not answer, or answers badly.

    Effect:
        None: nothing is begun.
    """
    feature = transport.feature(feature_id)
    core = transport.feature(CORE)
    names = [str(transport.read(core, name)) for name in ("ServerType", "ServerName")]
    return describe_feature(feature, doc=" ".join(names))


def describe_feature(feature: Feature, *, doc: str) -> Browsed:
    """Write down what a definition offers; what no spec can say is among the findings."""
    found = Collected()
    for one in feature.properties.values():
        _add_status(found, feature, one.value)
    for command in feature.commands.values():
        _add_action(found, feature, command)
    return found.browsed(
        name=feature.name,
        transport=SilaTransport.sort,
        doc=doc,
        protocol=f"SiLA 2, browsed {feature.id}",
    )


def _add_status(found: Collected, feature: Feature, value: Value) -> None:
    subject = f"{feature.id}/{value.name}"
    mapped = _value(found, value, subject)
    if mapped is None:
        return
    spec, factor, offset = mapped
    doc = value.doc or f"Tell {value.name}."
    binding = NodeBinding(node=subject, factor=factor, offset=offset)
    found.add(StatusSpec(name=spec.name, value=spec, doc=doc), binding)


def _add_action(found: Collected, feature: Feature, command: FeatureCommand) -> None:
    subject = f"{feature.id}/{command.name}"
    mapped = [_value(found, one, f"{subject}/{one.name}") for one in command.parameters]
    known = [one for one in mapped if one is not None]
    if len(known) < len(mapped):
        return
    scales = {(factor, offset) for spec, factor, offset in known if spec.type == "number"}
    if len(scales) > 1:
        found.refuse("argument", f"{command.name} has numbers in units that differ", subject)
        return
    factor, offset = scales.pop() if scales else (1.0, 0.0)
    doc = command.doc or f"Call {command.name}."
    parameters = tuple(spec for spec, _, _ in known)
    spec = ActionSpec(name=snake((command.name,)), parameters=parameters, doc=doc)
    found.add(spec, NodeBinding(node=subject, factor=factor, offset=offset))


def _value(
    found: Collected, value: Value, subject: str
) -> tuple[ParameterSpec, float, float] | None:
    sort = SORTS.get(value.basic)
    if sort is None:
        found.refuse("type", "the data type is no plain value", subject)
        return None
    name = snake((value.name,))
    if sort != "number":
        return ParameterSpec(name=name, type=sort, doc=value.doc), 1.0, 0.0
    scale = None if value.unit is None else scale_of(value.unit)
    if scale is None:
        label = "none" if value.unit is None else value.unit.label
        found.refuse("unit", f"unit {label} is not among those of the list", subject)
        return None
    unit, factor, offset = scale
    low, high = (
        None if bound is None else bound * factor + offset for bound in (value.low, value.high)
    )
    spec = ParameterSpec(
        name=f"{name}_{unit}",
        type="number",
        unit=unit,
        quantity=UNITS[unit][0],
        doc=value.doc,
        minimum=low,
        maximum=high,
    )
    return spec, factor, offset


def scale_of(unit: UnitConversion) -> tuple[str, float, float] | None:
    """Return our unit, and by what a number is multiplied and what is added to be in it.

    The published example writes Kelvin with the exponent 0 where 1 is meant; both are taken.

    Example:
        >>> scale_of(Unit("mL", 1e-6, 0.0, (("Meter", 3),)))
        ('ul', 1000.0, 0.0)
    """
    components = tuple(sorted(unit.components))
    found = SI.get((("Kelvin", 1),) if components == (("Kelvin", 0),) else components)
    if found is None:
        return None
    name, factor, offset = found
    return name, round(unit.factor * factor, 12), round(unit.offset * factor + offset, 12)
