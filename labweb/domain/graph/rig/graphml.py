"""GraphML as nodes and links, read without entities and without a document type."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser

from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.untrusted_json import MAX_BYTES, MAX_NODES, decode_json, refuse

GRAPHML = "http://graphml.graphdrawing.org/xmlns"
YED = "http://www.yworks.com/xml/graphml"
_DOCTYPE = re.compile(rb"<!\s*(?:DOCTYPE|ENTITY)", re.IGNORECASE)
_MOST_DEPTH = 200
_INTEGER = re.compile(r"-?[0-9]{1,19}")
_NUMBER = re.compile(r"-?[0-9]{1,25}(\.[0-9]{1,25})?([eE][+-]?[0-9]{1,3})?")

JSON_KEY = "json."
"""Beginning of the ids of keys whose text is JSON: lists, objects, and text with blank ends."""


@dataclass(frozen=True)
class GraphmlDocument:
    """A GraphML file."""

    value: Mapping[str, Any]
    """The same as a node-link graph."""

    text: str
    """The file itself."""


class _Bounded(TreeBuilder):
    """Builds a tree that is neither too deep nor too large."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0
        self._count = 0

    def start(self, tag: str, attrs: dict[str, str]) -> Element:
        self._depth += 1
        self._count += 1
        if self._depth > _MOST_DEPTH:
            raise refuse("lab_file.depth", f"the file is nested deeper than {_MOST_DEPTH} levels")
        if self._count > 50 * MAX_NODES:
            raise refuse("lab_file.too_many", "the file has too many elements")
        return super().start(tag, attrs)

    def doctype(self, name: str, public_id: str | None, system: str | None) -> None:
        del name, public_id, system
        raise refuse("lab_file.doctype", "the file declares a document type; none is read")

    def end(self, tag: str) -> Element:
        self._depth -= 1
        return super().end(tag)


def read_graphml(raw: bytes) -> GraphmlDocument:
    """Read GraphML.

    The label that yEd draws beside a node is its id; without one the XML id is. A node
    inside a group has its parent under `parent`. Data keys that a node or link leaves out
    have the default of their declaration.

    Raises:
        LabFileError: Not UTF-8, not XML (with line and column), a document type or an
            entity declared, or no graph in it.
    """
    if len(raw) > MAX_BYTES:
        raise refuse("lab_file.too_large", f"at most {MAX_BYTES} bytes are read")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refuse("lab_file.encoding", f"byte {error.start} is not UTF-8") from error
    if _DOCTYPE.search(raw):
        raise refuse(
            "lab_file.doctype", "the file declares a document type or an entity; none is read"
        )
    root = _parse(text)
    graph = root.find(f"{{{GRAPHML}}}graph") if root.tag == f"{{{GRAPHML}}}graphml" else None
    if graph is None:
        raise refuse("lab_file.no_nodes", "the file has no GraphML graph")
    keys = {
        str(key.get("id")): (str(key.get("attr.name") or ""), str(key.get("attr.type") or ""))
        for key in root.findall(f"{{{GRAPHML}}}key")
    }
    defaults = _defaults(root)
    nodes: list[dict[str, Any]] = []
    labels: dict[str, str] = {}
    _walk(graph, None, keys, defaults["node"], nodes, labels)
    links = [
        _link(edge, labels, keys, defaults["edge"]) for edge in graph.iter(f"{{{GRAPHML}}}edge")
    ]
    top = _data(graph, keys, {}).get("top")
    has_top = isinstance(top, Mapping) and not {"nodes", "links", "edges"} & set(top)
    value = {"nodes": nodes, "links": links, **(top if has_top and top else {})}
    return GraphmlDocument(value, text)


def _same(given: object, text: str) -> object:
    """Return a field that says the same as the XML attribute, with its type, or the text."""
    is_key = isinstance(given, int | str) and not isinstance(given, bool)
    return given if is_key and str(given) == text else text


def _parse(text: str) -> Element:
    parser = XMLParser(target=_Bounded())  # noqa: S314 - no document type, no entity, bounded
    stream = io.StringIO(text)
    try:
        while chunk := stream.read(65536):
            parser.feed(chunk)
        root = parser.close()
    except ParseError as error:
        line, column = error.position
        message = f"the file is not XML: line {line}, column {column}: {error.msg}"
        raise refuse("lab_file.xml", message) from error
    if not isinstance(root, Element):
        raise refuse("lab_file.xml", "the file has no element")
    return root


def _defaults(root: Element) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {"node": {}, "edge": {}}
    for key in root.findall(f"{{{GRAPHML}}}key"):
        default = key.find(f"{{{GRAPHML}}}default")
        if default is not None and key.get("for") in found:
            found[str(key.get("for"))][str(key.get("id"))] = (default.text or "").strip()
    return found


def _walk(
    graph: Element,
    parent: str | None,
    keys: Mapping[str, tuple[str, str]],
    defaults: Mapping[str, str],
    nodes: list[dict[str, Any]],
    labels: dict[str, str],
) -> None:
    for node in graph.findall(f"{{{GRAPHML}}}node"):
        own = str(node.get("id"))
        label = _label(node) or own
        labels[own] = label
        value = {"id": label, **_data(node, keys, defaults)}
        value["id"] = _same(value["id"], label)
        if parent is not None:
            value["parent"] = parent
        nodes.append(value)
        for inner in node.findall(f"{{{GRAPHML}}}graph"):
            _walk(inner, label, keys, defaults, nodes, labels)


def _label(node: Element) -> str:
    for data in node.findall(f"{{{GRAPHML}}}data"):
        for label in data.iter(f"{{{YED}}}NodeLabel"):
            text = (label.text or "").strip()
            if text:
                return text
    return ""


def _data(
    owner: Element, keys: Mapping[str, tuple[str, str]], defaults: Mapping[str, str]
) -> dict[str, Any]:
    texts = dict(defaults)
    for data in owner.findall(f"{{{GRAPHML}}}data"):
        if len(data) == 0 and data.text is not None and data.text.strip():
            texts[str(data.get("key"))] = data.text.strip()
    return {
        keys[key][0]: _typed(key, keys[key][1], text)
        for key, text in texts.items()
        if key in keys and keys[key][0] and text
    }


def _typed(key: str, type_: str, text: str) -> Any:  # noqa: ANN401 - what JSON can hold
    """Return a data field as its declared type; what does not fit stays text."""
    if key.startswith(JSON_KEY):
        try:
            return decode_json(text.encode())
        except LabFileError:
            return text
    if type_ == "boolean" and text in ("true", "false"):
        return text == "true"
    if type_ in ("int", "long") and _INTEGER.fullmatch(text):
        return int(text)
    if type_ in ("float", "double") and _NUMBER.fullmatch(text):
        return float(text) if math.isfinite(float(text)) else text
    return text


def _link(
    edge: Element,
    labels: Mapping[str, str],
    keys: Mapping[str, tuple[str, str]],
    defaults: Mapping[str, str],
) -> dict[str, Any]:
    value = _data(edge, keys, defaults)
    for end in ("source", "target"):
        own = str(edge.get(end))
        label = labels.get(own, own)
        value[end] = _same(value.get(end, label), label)
    if edge.get("id") is not None:
        own = str(edge.get("id"))
        value["id"] = _same(value.get("id", own), own)
    return value
