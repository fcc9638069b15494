"""What endpoints and topics answer with: structs that the schema describes."""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints
from uuid import UUID

import msgspec
from rest_framework.renderers import JSONRenderer


class ApiAnswer(msgspec.Struct):
    """What an endpoint or a topic says.

    A field that is always there has no default; one that may be left out is `T | UnsetType` and is
    `UNSET` then; one that may be empty is `T | None`. A time is a `datetime` with its zone, and is
    written in UTC.
    """


class NamedRef(ApiAnswer):
    """A thing by its id, with the name that a person knows it by."""

    id: UUID
    name: str


class KeyedRef(NamedRef):
    """A thing by its id, its name, and the key that files and documents call it by."""

    key: str


class NumberedRef(ApiAnswer):
    """A run or a version by its id, with the number that a person knows it by."""

    id: UUID
    number: int


class AnswerRenderer(JSONRenderer):
    """Writes structs as JSON, and refusals, which are none, as the library does."""

    def render(
        self,
        data: Any,  # noqa: ANN401 - the library's shape
        accepted_media_type: str | None = None,
        renderer_context: Mapping[str, Any] | None = None,
    ) -> Any:  # noqa: ANN401
        """Return the bytes of an answer."""
        if isinstance(data, ApiAnswer):
            return msgspec.json.encode(data)
        return super().render(data, accepted_media_type, renderer_context)


def answers_of(view: type, method: str) -> dict[int, type[ApiAnswer] | None]:
    """Return with what a view answers to a method, by status; None: without a body.

    Nothing is returned of a method that is annotated with a response alone.
    """
    listed: Mapping[str, Mapping[int, type[ApiAnswer]]] = getattr(view, "answers", {})
    if method in listed:
        return dict(listed[method])
    handler = getattr(view, method, None)
    told = None if handler is None else get_type_hints(handler).get("return", type(None))
    kinds = get_args(told) if get_origin(told) in (Union, UnionType) else (told,)
    found: dict[int, type[ApiAnswer] | None] = {}
    for kind in kinds:
        if kind is type(None):
            found[HTTPStatus.NO_CONTENT] = None
        elif isinstance(kind, type) and issubclass(kind, ApiAnswer):
            statuses: Mapping[str, int] = getattr(view, "statuses", {})
            found[statuses.get(method, HTTPStatus.OK)] = kind
    return found
