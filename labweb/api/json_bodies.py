"""JSON bodies, hostile until parsed."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import IO, Any, NoReturn

from rest_framework.exceptions import APIException, ParseError
from rest_framework.parsers import BaseParser

MAX_BODY_BYTES = 2 * 1024 * 1024
MAX_DEPTH = 32

_MOST_DIGITS = 300
"""Beyond this a number cannot be compared with a float, and limits are floats."""


class TooLargeError(APIException):
    """The body is larger than any request needs."""

    status_code = 413
    default_code = "too_large"
    default_detail = f"a request body may have {MAX_BODY_BYTES} bytes"


class StrictJSONParser(BaseParser):
    """JSON objects of finite numbers and storable text, of bounded size and depth."""

    media_type = "application/json"

    def parse(
        self,
        stream: IO[bytes],
        media_type: str | None = None,  # noqa: ARG002 - DRF's shape
        parser_context: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Read the body.

        Raises:
            ParseError: It is no JSON object, holds a number that is not finite or text
                that no database keeps, or is nested too deep.
            TooLargeError: It is too large; it was not read.
        """
        request = (parser_context or {}).get("request")
        length = int(request.META.get("CONTENT_LENGTH") or 0) if request is not None else 0
        if length > MAX_BODY_BYTES:
            raise TooLargeError
        raw = stream.read(MAX_BODY_BYTES + 1)
        if len(raw) > MAX_BODY_BYTES:
            raise TooLargeError
        try:
            value = json.loads(
                raw.decode("utf-8"),
                parse_constant=refuse_constant,
                parse_float=finite,
                parse_int=whole,
            )
            _check_texts(value)
        except (ValueError, RecursionError) as error:
            raise ParseError(f"the body is no JSON: {error}") from error
        if not isinstance(value, dict):
            raise ParseError("the body must be a JSON object")
        if _depth(value) > MAX_DEPTH:
            raise ParseError(f"the body is nested deeper than {MAX_DEPTH}")
        return value


def refuse_constant(name: str) -> NoReturn:
    """Refuse `NaN` and the infinities, which are no JSON."""
    raise ValueError(f"{name} is no number")


def whole(text: str) -> int:
    """Read a whole number that can be compared with any other; its field says how large it may be.

    Raises:
        ValueError: It has hundreds of digits.
    """
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"{text[:40]}… has {len(text)} digits: no number here has so many")
    return int(text)


def finite(text: str) -> float:
    """Read a number that a float can hold.

    Raises:
        ValueError: It is too large.
    """
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]} is beyond what a number can hold")
    return value


def _check_texts(value: object) -> None:
    left = [value]
    while left:
        node = left.pop()
        if isinstance(node, str):
            node.encode()
            if "\x00" in node:
                raise ValueError("a text holds U+0000")
        elif isinstance(node, dict):
            left += [*node.keys(), *node.values()]
        elif isinstance(node, list):
            left += node


def _depth(value: object) -> int:
    level, layer = 0, [value]
    while layer and level <= MAX_DEPTH:
        level += 1
        layer = [
            child
            for node in layer
            if isinstance(node, dict | list)
            for child in (node.values() if isinstance(node, dict) else node)
            if isinstance(child, dict | list)
        ]
    return level
