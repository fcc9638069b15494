"""Read typed bodies and query values from a request."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TypeVar

import msgspec
from rest_framework.request import Request

from labweb.domain.errors import DefinitionError

T = TypeVar("T", bound=msgspec.Struct)

_MOST_DIGITS = 18
"""Python reads no number of thousands of digits, and fails on it."""


def body(request: Request, shape: type[T]) -> T:
    """Read the body as a struct; unknown and missing fields are refused.

    Raises:
        DefinitionError: It does not fit; the message names the field.
    """
    try:
        return msgspec.convert(request.data, shape)
    except msgspec.ValidationError as error:
        raise DefinitionError(
            f"the request is not as described: {error}", code="http.body"
        ) from error


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
