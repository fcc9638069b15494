"""OpenAPI from the same structs that parse the bodies."""

from __future__ import annotations

from functools import partial
from typing import Any

import msgspec
from drf_spectacular.extensions import OpenApiAuthenticationExtension
from drf_spectacular.openapi import AutoSchema
from drf_spectacular.plumbing import ResolvedComponent
from drf_spectacular.utils import OpenApiParameter

from labweb.accounts.api import HEADER, acts
from labweb.api.access.token_sign_in import TokenAuthentication
from labweb.api.answers.refusals import REASONS, Refusal
from labweb.common.answers import answers_of


class TokenScheme(OpenApiAuthenticationExtension):  # type: ignore[no-untyped-call] # the library registers it
    """How a program signs in."""

    target_class = "labweb.api.access.token_sign_in.TokenAuthentication"
    name = "accessToken"

    def get_security_definition(self, auto_schema: AutoSchema) -> dict[str, str]:
        """Return the scheme: the secret of an access token in the Authorization header."""
        del auto_schema
        return {"type": "http", "scheme": "bearer", "description": "An access token of a person."}


_component: Any = partial(ResolvedComponent, type=ResolvedComponent.SCHEMA)
_response: Any = partial(ResolvedComponent, type=ResolvedComponent.RESPONSE)

_BYTES = {"type": "string", "format": "binary"}
_DOCUMENT = {"type": "object", "additionalProperties": True}
_FILES = {"application/json": {"title": "File", **_DOCUMENT}}
"""Media type of a file → its schema, where it is no bytes."""

_OF_EVERY = frozenset({400, 403, 404, 406, 429, 500, 503})
_OF_ACTS = frozenset({409, 412, 422, 423})
_OF_BODIES = frozenset({413, 415})


def refusals_of(view: Any, method: str) -> list[int]:  # noqa: ANN401 - any view of the library
    """Return with which statuses a method refuses: what its kind may, and what its view adds."""
    found = set(_OF_EVERY)
    if TokenAuthentication in view.authentication_classes:
        found.add(401)
    if method != "get":
        found |= _OF_ACTS
    if method in getattr(view, "bodies", {}) or method in getattr(view, "forms", {}):
        found |= _OF_BODIES
    if method == "get" and getattr(view, "queries", {}):
        found.add(422)
    return sorted(found | set(getattr(view, "refusals", {}).get(method, ())))


class LabSchema(AutoSchema):
    """Describes a view by its docstrings and by the structs its `bodies` name per method.

    A view that takes a form describes it as a JSON Schema in `forms`.
    """

    def get_operation_id(self) -> str:
        """Return a name made of method and path, so that none stands twice."""
        path = self.path.removeprefix("/api/v1/").replace("{", "by_").replace("}", "")
        return f"{self.method.lower()}_{path.replace('/', '_').replace('-', '_')}"

    def get_override_parameters(self) -> list[Any]:
        """Return the parameters of the address, and the key that every method takes that acts."""
        if self.method == "GET":
            return [
                OpenApiParameter(
                    name,
                    dict(one.schema),
                    OpenApiParameter.QUERY,
                    required=one.is_required,
                    description=one.description,
                )
                for name, one in getattr(self.view, "queries", {}).items()
            ]
        if not acts(type(self.view), self.method.lower()):
            return []
        name = "Names the wish: a new one for each, the same one each time that it is repeated."
        return [
            OpenApiParameter(
                HEADER,
                {"type": "string", "pattern": "^[!-~]{8,64}$"},
                OpenApiParameter.HEADER,
                required=True,
                description=name,
            )
        ]

    def get_request_serializer(self) -> Any:  # noqa: ANN401 - the library's shape
        """Return None: bodies are structs, not serializers."""
        return None

    def get_response_serializers(self) -> Any:  # noqa: ANN401 - the library's shape
        """Return None: answers are structs, not serializers."""
        return None

    def get_tags(self) -> list[str]:
        """Return the first word of the path."""
        return [self.path.removeprefix("/api/v1/").split("/")[0] or "schema"]

    def _get_request_body(self, direction: str = "request") -> dict[str, Any] | None:
        del direction
        form = getattr(self.view, "forms", {}).get(self.method.lower())
        if form is not None:
            return {"required": True, "content": {"multipart/form-data": {"schema": form}}}
        body = getattr(self.view, "bodies", {}).get(self.method.lower())
        if body is None:
            return None
        return {"required": True, "content": {"application/json": {"schema": self._shape(body)}}}

    def _shape(self, struct: type[msgspec.Struct]) -> dict[str, Any]:
        """Return the schema of a struct: a reference, and every component that it names is there.

        Raises:
            TypeError: Another struct has the same name.
        """
        (schema,), components = msgspec.json.schema_components(
            [struct], ref_template="#/components/schemas/{name}"
        )
        for name, found in components.items():
            shape = {key: value for key, value in found.items() if value != []}
            component: Any = _component(name, schema=shape, object=name)
            known = self.registry[component].schema if component in self.registry else shape
            if known != shape:
                raise TypeError(f"two structs of the interface are called {name}")
            self.registry.register_on_missing(component)
        return schema

    def _answers(self) -> dict[int, dict[str, Any]]:
        """Return what a method answers with by its status: JSON, or to GET a file.

        Raises:
            TypeError: The method does not say it.
        """
        kinds = _file_types(self.view) if self.method == "GET" else ()
        if kinds:
            return {200: {kind: {"schema": _FILES.get(kind, _BYTES)} for kind in kinds}}
        found = answers_of(type(self.view), self.method.lower())
        if not found:
            raise TypeError(f"{self.method} of {type(self.view).__name__} says no answer")
        shapes = {
            status: None if one is None else self._shape(one) for status, one in found.items()
        }
        if self._documents():
            shapes = {status: {"anyOf": [shape, _DOCUMENT]} for status, shape in shapes.items()}
        return {
            status: {} if shape is None else {"application/json": {"schema": shape}}
            for status, shape in shapes.items()
        }

    def _documents(self) -> dict[str, str]:
        """Return with which parameters GET answers with a document that is no struct."""
        return dict(getattr(self.view, "documents", {})) if self.method == "GET" else {}

    def get_extensions(self) -> dict[str, Any]:
        """Say the same, as `x-documents`."""
        return {"x-documents": found} if (found := self._documents()) else {}

    def _get_response_bodies(self, direction: str = "response") -> dict[str, Any]:
        del direction
        answers = {
            str(int(status)): {"description": "The answer"}
            | ({"content": content} if content else {})
            for status, content in self._answers().items()
        }
        return answers | {
            str(status): self._refused(status)
            for status in refusals_of(type(self.view), self.method.lower())
        }

    def _refused(self, status: int) -> dict[str, Any]:
        """Return a reference to the answer of a status above 399, which is there."""
        content = {"application/json": {"schema": self._shape(Refusal)}}
        component = _response(
            f"Refused{status}",
            schema={"description": REASONS[status], "content": content},
            object=f"Refused{status}",
        )
        self.registry.register_on_missing(component)
        return {"$ref": f"#/components/responses/Refused{status}"}


def _file_types(view: Any) -> tuple[str, ...]:  # noqa: ANN401 - any view of the library
    """Return the media types of the file that a view answers GET with; none: it is no file."""
    kind: str | None = getattr(view, "answer_type", None)
    return () if kind is None else (kind, *getattr(view, "more_types", ()))
