"""How what a driver declares reads in ROS 2. Pure.

A status is a topic, the settings are parameters, an action is an action of its own type. What
ROS 2 has no type for travels as JSON in a string.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from labweb.domain.enrollment.driver_spec import (
    ActionSpec,
    DriverSpec,
    ParameterSpec,
    StatusSpec,
)

PACKAGE = "labweb_interfaces"
"""ROS 2 package of the actions; `python -m workers.ros2 interfaces` writes it."""

_TOPICS = {
    "number": "std_msgs/msg/Float64",
    "integer": "std_msgs/msg/Int64",
    "boolean": "std_msgs/msg/Bool",
    "string": "std_msgs/msg/String",
}
_FIELDS = {"number": "float64", "integer": "int64", "boolean": "bool", "string": "string"}
_NOT_SET, _BOOL, _INTEGER, _DOUBLE, _STRING = range(5)
_KINDS = {"number": _DOUBLE, "integer": _INTEGER, "boolean": _BOOL, "string": _STRING}
_VALUES = {
    _BOOL: "bool_value",
    _INTEGER: "integer_value",
    _DOUBLE: "double_value",
    _STRING: "string_value",
}
_SECRET = re.compile(r"password|secret|token|credential")
RESULT = "string state\nstring message\nint64 run_number\nstring evidence"
FEEDBACK = "string state\nstring message"


def status_type(status: StatusSpec) -> str:
    """Return the type of the topic that tells a status."""
    return _TOPICS.get(status.value.type or "", "std_msgs/msg/String")


def status_message(status: StatusSpec, value: Any) -> dict[str, Any]:  # noqa: ANN401 - any JSON
    """Return the message of one value.

    Raises:
        TypeError, ValueError: It is no value of this status.
    """
    kind = status.value.type
    if kind == "number":
        return {"data": float(value)}
    if kind in _TOPICS:
        return {"data": value}
    return {"data": json.dumps(value, ensure_ascii=False, sort_keys=True)}


def offered_actions(spec: DriverSpec) -> list[ActionSpec]:
    """Return the actions that one step may call: all but those that move liquid.

    Liquid is moved by a transfer, which knows from where to where.
    """
    return [one for one in spec.actions if one.operation != "transfer" or one.name == "initialize"]


def action_name(spec: DriverSpec, action: ActionSpec) -> str:
    """Return the full name of an action's type.

    Example:
        >>> from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec
        >>> spec = DriverSpec(class_name="IkaRct", module="m", digest="")
        >>> action_name(spec, ActionSpec(name="heat_to"))
        'labweb_interfaces/action/IkaRctHeatTo'
    """
    words = "".join(word.capitalize() for word in action.name.split("_"))
    return f"{PACKAGE}/action/{spec.class_name}{words}"


def action_text(action: ActionSpec) -> str:
    """Return the definition of an action's type; what may be left out is an array of 0 or 1."""
    lines = [_field(parameter) for parameter in action.parameters]
    return "\n---\n".join(("\n".join(lines), RESULT, FEEDBACK))


def _field(parameter: ParameterSpec) -> str:
    kind = _FIELDS.get(parameter.type or "", "string")
    is_optional = parameter.nullable or not parameter.required
    return f"{kind}{'[<=1]' if is_optional else ''} {parameter.name}"


def action_arguments(action: ActionSpec, goal: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments that a goal stands for.

    Raises:
        ValueError: A text that should be JSON is none.
    """
    found: dict[str, Any] = {}
    for parameter in action.parameters:
        value = goal[parameter.name]
        if parameter.nullable or not parameter.required:
            if not value:
                continue
            value = value[0]
        is_json = (parameter.type or "") not in _FIELDS
        found[parameter.name] = json.loads(value) if is_json else value
    return found


def parameters_of(
    spec: DriverSpec, config: Mapping[str, Any]
) -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Return value and descriptor by name of each setting; secrets are left out."""
    found = {}
    for one in spec.config:
        if not _SECRET.search(one.name):
            value = config.get(one.name, one.default)
            found[one.name] = (parameter_value(one, value), _descriptor(one))
    return found


def parameter_value(
    parameter: ParameterSpec,
    value: Any,  # noqa: ANN401 - any JSON value
) -> dict[str, Any]:
    """Return a setting as a value of ROS 2; one that is not set is of type 0."""
    if value is None:
        return {"type": _NOT_SET}
    kind = _KINDS.get(parameter.type or "", _STRING)
    if parameter.type not in _KINDS:
        value = json.dumps(value, ensure_ascii=False, sort_keys=True)
    return {"type": kind, _VALUES[kind]: float(value) if kind == _DOUBLE else value}


def _descriptor(parameter: ParameterSpec) -> dict[str, Any]:
    kind = _KINDS.get(parameter.type or "", _STRING)
    told = [parameter.doc, f"in {parameter.symbol}" if parameter.symbol else ""]
    found: dict[str, Any] = {
        "name": parameter.name,
        "type": kind,
        "description": ", ".join(one for one in told if one),
        "read_only": True,
    }
    if parameter.choices:
        found["additional_constraints"] = f"one of {', '.join(map(str, parameter.choices))}"
    low, high = parameter.minimum, parameter.maximum
    if kind == _DOUBLE and low is not None and high is not None:
        found["floating_point_range"] = [{"from_value": float(low), "to_value": float(high)}]
    if kind == _INTEGER and low is not None and high is not None:
        found["integer_range"] = [{"from_value": int(low), "to_value": int(high)}]
    return found
