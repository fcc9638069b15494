"""Messages of SiLA 2 as protocol buffers, made of a feature's definition.

Source:
    SiLA 2, part (B) 1.1, "Mapping of features to protocol buffers", and its `SiLAFramework.proto`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from google.protobuf import (  # type: ignore[import-untyped]
    descriptor_pb2,
    descriptor_pool,
    message_factory,
)
from google.protobuf.message import Message  # type: ignore[import-untyped]

from drivers.transports.sila.features import Value

PACKAGE = "sila2.org.silastandard"
_Field = descriptor_pb2.FieldDescriptorProto
_PLAIN = {
    "Real": _Field.TYPE_DOUBLE,
    "Integer": _Field.TYPE_INT64,
    "Boolean": _Field.TYPE_BOOL,
    "String": _Field.TYPE_STRING,
}
_FRAMEWORK: Mapping[str, Sequence[tuple[int, str, int | str]]] = {
    **{name: ((1, "value", sort),) for name, sort in _PLAIN.items()},
    "CommandExecutionUUID": ((1, "value", _Field.TYPE_STRING),),
    "CommandConfirmation": ((1, "commandExecutionUUID", "CommandExecutionUUID"),),
    "ExecutionInfo": ((1, "commandStatus", _Field.TYPE_INT32),),
    "ValidationError": ((1, "parameter", _Field.TYPE_STRING), (2, "message", _Field.TYPE_STRING)),
    "DefinedExecutionError": (
        (1, "errorIdentifier", _Field.TYPE_STRING),
        (2, "message", _Field.TYPE_STRING),
    ),
    "UndefinedExecutionError": ((1, "message", _Field.TYPE_STRING),),
    "FrameworkError": ((1, "errorType", _Field.TYPE_INT32), (2, "message", _Field.TYPE_STRING)),
    "SiLAError": (
        (1, "validationError", "ValidationError"),
        (2, "definedExecutionError", "DefinedExecutionError"),
        (3, "undefinedExecutionError", "UndefinedExecutionError"),
        (4, "frameworkError", "FrameworkError"),
    ),
}
"""Fields of the framework's messages that are read; an enumeration is a number on the wire."""


class Messages:
    """Makes message classes, in a pool of their own."""

    def __init__(self) -> None:
        """Begin with those of the framework."""
        self._pool = descriptor_pool.DescriptorPool()
        self._count = 0
        file = descriptor_pb2.FileDescriptorProto(name="f", package=PACKAGE, syntax="proto3")
        for name, fields in _FRAMEWORK.items():
            _add(file, name, fields)
        self._pool.Add(file)

    def framework(self, name: str) -> type[Message]:
        """Return a message class of the framework."""
        return self._class(f"{PACKAGE}.{name}")

    def of(self, values: Sequence[Value], *, is_list: bool = False) -> type[Message]:
        """Return the class of a message with these plain values, numbered from 1."""
        self._count += 1
        package = f"made{self._count}"
        file = descriptor_pb2.FileDescriptorProto(name=package, package=package, syntax="proto3")
        file.dependency.append("f")
        fields = [(at, one.name, one.basic) for at, one in enumerate(values, start=1)]
        _add(file, "Made", fields, is_list=is_list)
        self._pool.Add(file)
        return self._class(f"{package}.Made")

    def _class(self, name: str) -> type[Message]:
        found = self._pool.FindMessageTypeByName(name)
        made: type[Message] = message_factory.GetMessageClass(found)
        return made


def _add(
    file: descriptor_pb2.FileDescriptorProto,
    name: str,
    fields: Sequence[tuple[int, str, int | str]],
    *,
    is_list: bool = False,
) -> None:
    message = file.message_type.add(name=name)
    label = _Field.LABEL_REPEATED if is_list else _Field.LABEL_OPTIONAL
    for number, field_name, sort in fields:
        one = message.field.add(name=field_name, number=number, label=label)
        if isinstance(sort, str):
            one.type, one.type_name = _Field.TYPE_MESSAGE, f".{PACKAGE}.{sort}"
        else:
            one.type = sort


def fill(made: type[Message], values: Mapping[str, object]) -> Message:
    """Return a message with these plain values."""
    message = made()
    for name, value in values.items():
        getattr(message, name).value = value
    return message


def plain(message: Message, name: str) -> Any:  # noqa: ANN401 - a plain value
    """Return one value of a message."""
    return getattr(message, name).value
