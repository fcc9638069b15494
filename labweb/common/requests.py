"""Read typed bodies and query values from a request."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from typing import Any, TypeVar
from uuid import UUID

import msgspec
from msgspec import inspect
from rest_framework.exceptions import APIException
from rest_framework.request import Request

from labweb.domain.errors import DefinitionError, Finding

T = TypeVar("T", bound=msgspec.Struct)

_MOST_FINDINGS = 100
_LONGEST_PATH = 200

_MOST_DIGITS = 18
"""Python reads no number of thousands of digits, and fails on it."""


class Nothing(msgspec.Struct, forbid_unknown_fields=True):
    """Body of an act that takes no arguments."""


class UnknownParameterError(APIException):
    """An address has a parameter that nobody reads; whoever wrote it means something by it."""

    status_code = 400
    default_code = "http.unknown_parameter"


@dataclass(frozen=True, slots=True)
class Parameter:
    """What an endpoint takes in its address, `?name=value`."""

    schema: Mapping[str, Any]
    """JSON Schema; of `array` it may stand several times."""

    description: str = ""
    is_required: bool = False


def one_of(names: Iterable[str], description: str = "") -> Parameter:
    """Return a parameter that takes one of these words."""
    return Parameter({"type": "string", "enum": list(names)}, description)


def id_of(what: str) -> Parameter:
    """Return a parameter that takes an id."""
    return Parameter({"type": "string", "format": "uuid"}, f"Id of {what}.")


def check_query(request: Request, known: Mapping[str, Parameter]) -> None:
    """Refuse parameters that the endpoint does not have, that stand twice, or hold no text.

    Raises:
        UnknownParameterError: One is unknown; the message names those that exist.
        DefinitionError: One stands twice, or its value cannot be stored anywhere.
    """
    for name, values in request.query_params.lists():
        if name not in known:
            there = f"this address takes {', '.join(known)}" if known else "this address takes none"
            raise UnknownParameterError(f"unknown parameter `{name[:_LONGEST_PATH]}`: {there}")
        if len(values) > 1 and known[name].schema.get("type") != "array":
            raise DefinitionError(f"{name} stands {len(values)} times: once", code="http.query")
        if any("\x00" in value or (not value.isascii() and _is_torn(value)) for value in values):
            raise DefinitionError(f"{name} holds a character that is none", code="http.query")


def _is_torn(text: str) -> bool:
    return any("\ud800" <= letter <= "\udfff" for letter in text)


def body(request: Request, shape: type[T]) -> T:
    """Read the body as a struct; unknown and missing fields are refused, nested ones too.

    Raises:
        DefinitionError: It does not fit; the message names the field by its path, and the findings
            list every field that is unknown.
    """
    unknown = list(_unknown_fields(request.data, _described(shape), ""))
    if unknown:
        more = f" (and {len(unknown) - 1} more)" if len(unknown) > 1 else ""
        raise DefinitionError(
            f"the request is not as described: {unknown[0].message}{more}",
            code="http.body",
            findings=unknown[:_MOST_FINDINGS],
        )
    try:
        return msgspec.convert(request.data, shape)
    except msgspec.ValidationError as error:
        raise DefinitionError(
            f"the request is not as described: {error}", code="http.body"
        ) from error


@cache
def _described(shape: type[msgspec.Struct]) -> inspect.Type:
    return inspect.type_info(shape)


def _unknown_fields(value: object, shape: inspect.Type, path: str) -> Iterator[Finding]:
    """Yield every field of a body that the struct which reads it does not have.

    A struct that is also read out of messages of other versions cannot refuse them itself.
    """
    if isinstance(shape, inspect.StructType) and isinstance(value, dict):
        yield from _unknown_here(value, shape, path)
    for inner, kind, at in _inside(value, shape, path):
        yield from _unknown_fields(inner, kind, at)


def _inside(
    value: object, shape: inspect.Type, path: str
) -> Iterator[tuple[object, inspect.Type, str]]:
    """Yield what a value holds that is no field: items, entries, or itself as one of a union."""
    match shape:
        case inspect.UnionType():
            yield from ((value, one, path) for one in shape.types if _is_meant(value, one))
        case inspect.DictType() if isinstance(value, dict):
            for name, inner in value.items():
                yield inner, shape.value_type, f"{path}.{name}"
        case inspect.ListType() | inspect.VarTupleType() if isinstance(value, list):
            for index, inner in enumerate(value):
                yield inner, shape.item_type, f"{path}[{index}]"
        case _:
            return


def _unknown_here(
    value: dict[str, object], shape: inspect.StructType, path: str
) -> Iterator[Finding]:
    known = {field.encode_name: field.type for field in shape.fields}
    for name, inner in value.items():
        at = f"{path}.{name}" if path else name
        if name in known:
            yield from _unknown_fields(inner, known[name], at)
        elif name != shape.tag_field:
            told = at[:_LONGEST_PATH]
            text = f"unknown field `{told}`; known are {', '.join(sorted(known)) or 'none'}"
            yield Finding("http.unknown_field", text, told, {"field": told})


def _is_meant(value: object, shape: inspect.Type) -> bool:
    """Tell whether a value of a union is to be read as this one of its types."""
    if not isinstance(shape, inspect.StructType):
        return True
    return isinstance(value, dict) and (
        shape.tag_field is None or value.get(shape.tag_field) == shape.tag
    )


def whole_number(request: Request, name: str, *, default: int, low: int, high: int) -> int:
    """Read a whole number from the query.

    Raises:
        DefinitionError: It is no number, or outside the range.
    """
    text = request.query_params.get(name)
    if text is None:
        return default
    is_number = text.isascii() and text.isdigit() and len(text) <= _MOST_DIGITS
    if not is_number or not low <= int(text) <= high:
        raise DefinitionError(f"{name} must be {low} to {high}", code="http.query")
    return int(text)


def word(request: Request, name: str, known: Sequence[str]) -> str:
    """Read one of the words that a parameter offers; the first is what goes without saying.

    Raises:
        DefinitionError: It is none of them.
    """
    text = request.query_params.get(name, known[0])
    if text not in known:
        raise DefinitionError(f"{name} is {_either(known)}", code="http.query")
    return str(text)


def _either(words: Sequence[str]) -> str:
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def identity(request: Request, name: str) -> UUID:
    """Read an id from the query.

    Raises:
        DefinitionError: It is none, or left out.
    """
    try:
        return UUID(request.query_params.get(name, ""))
    except ValueError as error:
        raise DefinitionError(f"{name} must be an id", code="http.query") from error


def seconds(request: Request, name: str, default: float) -> float:
    """Read seconds since the Unix epoch from the query.

    Raises:
        DefinitionError: It is no finite number.
    """
    text = request.query_params.get(name)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError as error:
        raise DefinitionError(f"{name} must be seconds", code="http.query") from error
    if not 0 <= value < 1e11:
        raise DefinitionError(f"{name} is no time", code="http.query")
    return value


def moment(request: Request, name: str) -> datetime | None:
    """Read a time from the query, ISO 8601 with its zone, as UTC; None: it is not asked for.

    Raises:
        DefinitionError: It is no time, or says no zone.
    """
    text = request.query_params.get(name)
    if text is None:
        return None
    try:
        at = datetime.fromisoformat(text)
    except ValueError as error:
        raise DefinitionError(f"{name} must be a time in ISO 8601", code="http.query") from error
    if at.tzinfo is None:
        raise DefinitionError(f"{name} must say its zone: end it with Z", code="http.query")
    try:
        return at.astimezone(UTC)
    except OverflowError as error:
        raise DefinitionError(f"{name} is no time in UTC", code="http.query") from error
