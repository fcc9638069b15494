"""OpenAPI from the same structs that parse the bodies."""

from __future__ import annotations

from typing import Any

import msgspec
from drf_spectacular.openapi import AutoSchema
from drf_spectacular.utils import OpenApiParameter

from labweb.accounts.api import HEADER, acts

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

_ANSWER: dict[str, Any] = {"type": "object", "additionalProperties": True}


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
        """Return None: answers are rendered by functions, not serializers."""
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
        (schema,), components = msgspec.json.schema_components(
            [body], ref_template="#/components/schemas/{name}"
        )
        found = components.get(schema.get("$ref", "").rsplit("/", 1)[-1], schema)
        shape = {key: value for key, value in found.items() if value != []}
        return {"required": True, "content": {"application/json": {"schema": shape}}}

    def _answer(self) -> dict[str, Any]:
        """Return what a view answers with: JSON, or to GET a file of its `answer_type`."""
        kind = getattr(self.view, "answer_type", None) if self.method == "GET" else None
        if kind is None:
            return {"application/json": {"schema": _ANSWER}}
        return {kind: {"schema": {"type": "string", "format": "binary"}}}

    def _get_response_bodies(self, direction: str = "response") -> dict[str, Any]:
        del direction
        answer = {"content": self._answer(), "description": "The answer"}
        refusal = {"content": {"application/json": {"schema": REFUSAL}}, "description": "Refused"}
        return {"2XX": answer, "4XX": refusal}
