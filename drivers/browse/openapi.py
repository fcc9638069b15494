"""Write down what an OpenAPI document offers on one path, as a spec.

Source:
    OpenAPI Specification 3.0.3, "Path Item Object" and "Schema Object" (readOnly, nullable, enum).
"""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import msgspec

from drivers.browse.browsed import Browsed, Collected, NodeBinding, snake
from drivers.transports.http import HttpTransport
from labweb.domain.enrollment.driver_spec import ActionSpec, ParameterSpec, StatusSpec
from labweb.domain.errors import DefinitionError, NotFoundError

FETCH_S = 10.0
MOST_BYTES = 8 * 1024 * 1024
PORTS = {"http": 80, "https": 443}
MOST_LEVELS = 8
GOOD = "200"
Json = Mapping[str, Any]


def fetch_document(url: str) -> dict[str, Any]:
    """Read a document from the server that it describes.

    Only the address that is named is asked: no redirect is followed and no proxy asked, and a
    certificate has to be one that this machine trusts.

    Raises:
        DefinitionError: The address is none, or what it gives is no JSON object.
        DeviceError: Nobody answers in 10 s, or with more than 8 MiB, or with no HTTP.
    """
    host, port, target = _address(url)
    encryption = ssl.create_default_context() if url.startswith("https:") else None
    transport = HttpTransport(url, host, port, encryption=encryption)
    transport.open()
    try:
        reply = transport.get(target, timeout_s=FETCH_S, longest_bytes=MOST_BYTES)
    finally:
        transport.close()
    if reply.status != HTTPStatus.OK:
        leads = reply.headers.get("location", "")
        text = f"{url} answers {reply.status}" + (f" and leads to {leads:.300}" if leads else "")
        raise DefinitionError(
            f"{text}; name the address that has the document", code="browse.address"
        )
    return parse_document(reply.body, url)


def parse_document(data: bytes, place: str) -> dict[str, Any]:
    """Read a document from bytes.

    Raises:
        DefinitionError: They are no JSON object.
    """
    try:
        return msgspec.json.decode(data, type=dict[str, Any])
    except (msgspec.MsgspecError, RecursionError) as error:
        text = f"{place} is no JSON document: {error}"
        raise DefinitionError(text, code="browse.file") from error


def _address(url: str) -> tuple[str, int, str]:
    """Return host, port, and what is asked for there."""
    try:
        parts = urlsplit(url)
        port = parts.port or PORTS[parts.scheme]
    except (ValueError, KeyError) as error:
        raise DefinitionError(f"{url!r}: {error}", code="browse.address") from error
    if not parts.hostname or "@" in parts.netloc or parts.fragment:
        text = f"{url!r} is no address of a document: https://192.168.1.20/openapi.json"
        raise DefinitionError(text, code="browse.address")
    return parts.hostname, port, (parts.path or "/") + (f"?{parts.query}" if parts.query else "")


def browse_document(document: Json, path: str) -> Browsed:
    """Write down what is read and put on one path of a document.

    Texts and truth values of what GET returns become statuses; those that PUT takes as well become
    actions that set them. A number has no unit in such a document, and is left out.

    Raises:
        NotFoundError: The document has no such path; `context["names"]` lists those it has.
    """
    paths = document.get("paths")
    item = paths.get(path) if isinstance(paths, dict) else None
    if not isinstance(item, dict):
        raise NotFoundError(
            f"the document has no path {path!r}",
            code="browse.not_found",
            context={"names": sorted(paths) if isinstance(paths, dict) else []},
        )
    walk = _Walk(document, path, Collected())
    told = _schema(item.get("get"), "responses", GOOD)
    taken = _schema(item.get("put"), "requestBody")
    if told is not None:
        walk.visit(told, (), is_settable=taken is not None and taken == told)
    if isinstance(item.get("put"), dict) and "requestBody" not in item["put"]:
        walk.add_call(item["put"])
    info = document.get("info") or {}
    return walk.found.browsed(
        name=path.rpartition("/")[2] or "root",
        transport="http",
        doc=str(info.get("title") or ""),
        protocol=f"HTTP, browsed {path} of version {info.get('version') or 'none'}",
    )


def _schema(operation: object, *names: str) -> Json | None:
    found: Any = operation
    for name in names:
        found = found.get(name) if isinstance(found, dict) else None
    content = found.get("content") if isinstance(found, dict) else None
    if not isinstance(content, dict):
        return None
    kind = next((one for sort, one in content.items() if "json" in sort), None)
    return kind.get("schema") if isinstance(kind, dict) else None


@dataclass
class _Walk:
    """Collects while it goes from schema to schema."""

    document: Json
    path: str
    found: Collected

    def visit(self, schema: Json, way: tuple[str, ...], *, is_settable: bool) -> None:
        """Look at all below a schema."""
        subject = f"{self.path} {'.'.join(way)}"
        if len(way) > MOST_LEVELS:
            self.found.refuse("too_many", f"more than {MOST_LEVELS} levels", subject)
            return
        whole = self._resolved(schema)
        is_settable = is_settable and not whole.get("readOnly")
        properties = whole.get("properties")
        if isinstance(properties, dict):
            for name, one in properties.items():
                self.visit(one, (*way, name), is_settable=is_settable)
        else:
            self._add(whole, way, subject, is_settable=is_settable)

    def add_call(self, operation: Json) -> None:
        """Keep a PUT that takes nothing."""
        name = snake((str(operation.get("operationId") or self.path),))
        doc = str(operation.get("summary") or f"Call PUT {self.path}.")
        self.found.add(ActionSpec(name=name, doc=doc), NodeBinding(node=f"PUT {self.path}"))

    def _add(self, whole: Json, way: tuple[str, ...], subject: str, *, is_settable: bool) -> None:
        sort = whole.get("type")
        if sort in {"number", "integer"}:
            self.found.refuse("unit", "a number, and the document says no unit", subject)
            return
        if sort not in {"boolean", "string"}:
            self.found.refuse("type", f"{sort or 'no type'} is no plain value", subject)
            return
        value = ParameterSpec(
            name=snake(way),
            type=sort,
            nullable=bool(whole.get("nullable")),
            doc=str(whole.get("description") or ""),
            choices=tuple(whole.get("enum") or ()),
        )
        doc = value.doc or f"Tell {'.'.join(way)}."
        status = StatusSpec(name=value.name, value=value, doc=doc)
        self.found.add(status, NodeBinding(node=f"GET {subject}"))
        if is_settable:
            setter = ActionSpec(
                name=f"set_{value.name}",
                parameters=(value,),
                doc=f"Put {'.'.join(way)}.",
                recovery="R1",
            )
            self.found.add(setter, NodeBinding(node=f"PUT {subject}"))

    def _resolved(self, schema: Json) -> dict[str, Any]:
        """Join a schema with what it refers to; what stands beside a reference stays."""
        joined: dict[str, Any] = {}
        parts: list[tuple[Json, int]] = [(schema, 0)]
        while parts:
            part, depth = parts.pop()
            if depth > MOST_LEVELS or not isinstance(part, dict):
                continue
            parts += [(one, depth + 1) for one in part.get("allOf", [])]
            choices = part.get("oneOf", [])
            parts += [(choices[0], depth + 1)] if len(choices) == 1 else []
            reference = str(part.get("$ref") or "")
            if reference.startswith("#/components/schemas/"):
                parts.append((self._named(reference.rpartition("/")[2]), depth + 1))
            for name, value in part.items():
                if name == "properties" and isinstance(joined.get(name), dict):
                    joined[name] = {**value, **joined[name]}
                else:
                    joined.setdefault(name, value)
        return joined

    def _named(self, name: str) -> Json:
        schemas = (self.document.get("components") or {}).get("schemas") or {}
        found = schemas.get(name)
        return found if isinstance(found, dict) else {}
