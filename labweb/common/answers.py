"""What endpoints and topics answer with: structs that the schema describes."""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus
from types import UnionType
from typing import Any, ClassVar, Union, get_args, get_origin, get_type_hints

import msgspec
from rest_framework.renderers import JSONRenderer


class ApiAnswer(msgspec.Struct):
    """What an endpoint or a topic says.

    A field that is always there has no default; one that may be left out is `T | UnsetType` and is
    `UNSET` then; one that may be empty is `T | None`. A time is a `datetime` with its zone, and is
    written in UTC.
    """


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


class Answering:
    """Says per method with which struct a view answers: by what the method is annotated with."""

    statuses: ClassVar[Mapping[str, int]] = {}
    """Method, in small letters → status of its answer, where that is neither 200 nor 204."""

    documents: ClassVar[Mapping[str, str]] = {}
    """Parameter of the address → value with which GET answers with a document of a format of its
    own, and with no struct."""

    answers: ClassVar[Mapping[str, Mapping[int, type[ApiAnswer]]]] = {}
    """Method → status → answer, of a method that has more than one and returns responses."""


def answers_of(view: type, method: str) -> dict[int, type[ApiAnswer] | None]:
    """Return the answers of a view to a method by their status; None: one without a body.

    Nothing is returned of a method that is annotated with a response: it answers with a file.
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
