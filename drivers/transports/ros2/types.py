"""Messages of ROS 2 as types of Cyclone DDS, and as plain data.

Source:
    Type names and CDR as rosidl makes them: `geometry_msgs::msg::dds_::Point_`, XCDR1, all
    types final; an empty structure has one octet.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl import types as idl

from drivers.transports.ros2.message_definitions import DEEPEST, Definitions, Field
from labweb.domain.errors import DefinitionError, FrameError

_TYPES: Mapping[str, Any] = {
    "bool": bool,
    "byte": idl.uint8,
    "char": idl.uint8,
    "float32": idl.float32,
    "float64": idl.float64,
    "string": str,
    **{f"int{bits}": getattr(idl, f"int{bits}") for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": getattr(idl, f"uint{bits}") for bits in (8, 16, 32, 64)},
}
_SHAPES: Any = idl
"""Its subscripts are not typed."""

_FILLER = Field(name="structure_needs_at_least_one_member", type="uint8")
_LIMITS: Mapping[str, tuple[int, int]] = {
    "byte": (0, 255),
    "char": (0, 255),
    **{f"int{bits}": (-(1 << bits - 1), (1 << bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, (1 << bits) - 1) for bits in (8, 16, 32, 64)},
}


class Types:
    """Types by the full name of their message; each is made once."""

    def __init__(self, definitions: Definitions) -> None:
        self.definitions = definitions
        self._types: dict[str, type[IdlStruct]] = {}

    def of(self, name: str, depth: int = 0) -> type[IdlStruct]:
        """Return the type of a message.

        Raises:
            DefinitionError: It, or a message in it, is not defined, or it holds itself.
        """
        if depth > DEEPEST:
            raise DefinitionError(f"{name} is too deep, or holds itself", code="ros2.interface")
        if name not in self._types:
            fields = {field.name: self._field(field, depth) for field in self._fields(name)}
            short = name.rpartition("/")[2]
            self._types[name] = make_idl_struct(short, type_name(name), fields)
        return self._types[name]

    def _fields(self, name: str) -> tuple[Field, ...]:
        return self.definitions.message(name).fields or (_FILLER,)

    def _field(self, field: Field, depth: int) -> Any:  # noqa: ANN401 - a type of the library's
        if field.longest is not None:
            one: Any = _SHAPES.bounded_str[field.longest]
        else:
            one = _TYPES.get(field.type) or self.of(field.type, depth + 1)
        if field.count is not None:
            return _SHAPES.array[one, field.count]
        if field.most is None:
            return one
        return _SHAPES.sequence[one, field.most] if field.most else _SHAPES.sequence[one]

    def encode(self, name: str, value: Mapping[str, Any]) -> bytes:
        """Render plain data as CDR, with its four bytes of encapsulation.

        Raises:
            DefinitionError: As `build`.
        """
        return bytes(self.build(name, value).serialize(use_version_2=False))

    def decode(self, name: str, data: bytes) -> dict[str, Any]:
        """Read CDR into plain data.

        Raises:
            FrameError: The bytes are no such message.
        """
        try:
            return self.plain(name, self.of(name).deserialize(data))
        except DefinitionError:
            raise
        except Exception as error:
            raise FrameError(f"{len(data)} bytes are no {name}: {error}") from error

    def build(self, name: str, value: Mapping[str, Any]) -> IdlStruct:
        """Make a message of plain data; what is left out is zero, as in ROS 2.

        Raises:
            DefinitionError: A field is unknown, or a value does not fit; it names the field.
        """
        fields = {field.name: field for field in self._fields(name)}
        if not isinstance(value, Mapping):
            raise _misfit(name, value, "an object")
        unknown = sorted(set(value) - set(fields))
        if unknown:
            raise DefinitionError(
                f"{name} has no {unknown}: it has {sorted(fields)}", code="ros2.message"
            )
        made = {
            key: self._values(field, value[key], f"{name}.{key}")
            if key in value
            else self._empty(field)
            for key, field in fields.items()
        }
        return self.of(name)(**made)

    def plain(self, name: str, message: IdlStruct) -> dict[str, Any]:
        """Return a message as plain data."""
        fields = self.definitions.message(name).fields
        return {field.name: self._plain(field, getattr(message, field.name)) for field in fields}

    def _plain(self, field: Field, value: Any) -> Any:  # noqa: ANN401 - any JSON value
        is_message = field.type not in _TYPES
        if field.count is None and field.most is None:
            return self.plain(field.type, value) if is_message else value
        return [self.plain(field.type, one) if is_message else one for one in value]

    def _empty(self, field: Field) -> Any:  # noqa: ANN401 - any value
        if field.most is not None:
            return []
        if field.type in _TYPES:
            zero: Any = _TYPES[field.type]() if field.type in {"bool", "string"} else 0
            zero = 0.0 if field.type.startswith("float") else zero
        else:
            zero = None
        if field.count is None:
            return self.build(field.type, {}) if zero is None else zero
        return [self.build(field.type, {}) if zero is None else zero for _ in range(field.count)]

    def _values(self, field: Field, value: Any, where: str) -> Any:  # noqa: ANN401 - any value
        if field.count is None and field.most is None:
            return self._value(field, value, where)
        if not isinstance(value, Sequence) or isinstance(value, str):
            raise _misfit(where, value, "an array")
        if field.count is not None and len(value) != field.count:
            raise _misfit(where, value, f"an array of {field.count}")
        if field.most and len(value) > field.most:
            raise _misfit(where, value, f"an array of at most {field.most}")
        return [self._value(field, one, where) for one in value]

    def _value(self, field: Field, value: Any, where: str) -> Any:  # noqa: ANN401 - any value
        match field.type:
            case "bool":
                is_fit = isinstance(value, bool)
            case "string":
                is_fit = isinstance(value, str) and "\0" not in value
                is_fit = is_fit and len(value.encode()) <= (field.longest or len(value) * 4)
            case "float32" | "float64":
                is_fit = isinstance(value, int | float) and not isinstance(value, bool)
                return _number(value, field.type, where) if is_fit else _raise(where, value, field)
            case kind if kind in _LIMITS:
                low, high = _LIMITS[kind]
                is_fit = isinstance(value, int) and not isinstance(value, bool)
                is_fit = is_fit and low <= value <= high
            case _:
                return self.build(field.type, value)
        return value if is_fit else _raise(where, value, field)


_LARGEST_FLOAT32 = 3.4028234663852886e38


def _number(value: float, kind: str, where: str) -> float:
    found = float(value)
    if kind == "float32" and math.isfinite(found) and abs(found) > _LARGEST_FLOAT32:
        raise _misfit(where, value, kind)
    return found


def _raise(where: str, value: object, field: Field) -> Any:  # noqa: ANN401 - never returns
    raise _misfit(where, value, field.type)


def _misfit(where: str, value: object, wanted: str) -> DefinitionError:
    return DefinitionError(
        f"{where} is {str(value)[:80]!r}, wanted is {wanted}", code="ros2.message"
    )


def type_name(name: str) -> str:
    """Return the name that a message has on the wire.

    Example:
        >>> type_name("geometry_msgs/msg/Point")
        'geometry_msgs::msg::dds_::Point_'
    """
    package, sort, short = name.split("/")
    return f"{package}::{sort}::dds_::{short}_"
