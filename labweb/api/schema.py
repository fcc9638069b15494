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
from labweb.common.answers import answers_of

REFUSAL: dict[str, Any] = {
    "type": "object",
    "description": "Why the request was refused; nothing changed.",
    "required": ["code", "message", "effect", "context", "findings"],
    "properties": {
        "code": {"type": "string"},
        "message": {"type": "string"},
        "effect": {"type": "string", "enum": ["none", "partial", "unknown"]},
        "context": {"type": "object", "additionalProperties": True},
        "findings": {"type": "array", "items": {"type": "object", "additionalProperties": True}},
    },
}
"""Shape of every answer above 399."""


class TokenScheme(OpenApiAuthenticationExtension):  # type: ignore[no-untyped-call] # the library registers it
    """How a program signs in."""

    target_class = "labweb.api.access.token_sign_in.TokenAuthentication"
    name = "accessToken"

    def get_security_definition(self, auto_schema: AutoSchema) -> dict[str, str]:
        """Return the scheme: the secret of an access token in the Authorization header."""
        del auto_schema
        return {"type": "http", "scheme": "bearer", "description": "An access token of a person."}


_component: Any = partial(ResolvedComponent, type=ResolvedComponent.SCHEMA)


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
        kind = getattr(self.view, "answer_type", None) if self.method == "GET" else None
        if kind is not None:
            return {200: {kind: {"schema": {"type": "string", "format": "binary"}}}}
        found = answers_of(type(self.view), self.method.lower())
        if not found:
            raise TypeError(f"{self.method} of {type(self.view).__name__} says no answer")
        shapes = {
            status: None if one is None else self._shape(one) for status, one in found.items()
        }
        if self._documents():
            document = {"type": "object", "additionalProperties": True}
            shapes = {status: {"oneOf": [shape, document]} for status, shape in shapes.items()}
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
        refusal = {"content": {"application/json": {"schema": REFUSAL}}, "description": "Refused"}
        answers = {
            str(int(status)): {"description": "The answer"}
            | ({"content": content} if content else {})
            for status, content in self._answers().items()
        }
        return answers | {"4XX": refusal}
