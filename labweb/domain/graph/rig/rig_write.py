"""Write a physical graph, with everything that was read of it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from labweb.domain.graph.lab_file.untrusted_json import refuse
from labweb.domain.graph.rig.graphml import GRAPHML, JSON_KEY
from labweb.domain.graph.rig.rig_model import Rig, RigFormat

_UNHELD = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
"""What no XML holds, and so no id, port or name of a field in it."""

_PLAIN = re.compile(r"[^\x00-\x08\x0b\x0c\x0d\x0e-\x1f\ud800-\udfff\ufffe\uffff]*")
_FOR_NODES, _FOR_LINKS = "node", "edge"


def write_rig(rig: Rig, wanted: RigFormat | None = None) -> bytes:
    """Write a rig in its own format or as another.

    A node-link graph is given back with every field of every node and link; GraphML and a
    `lab.json` are given back as they stand. As GraphML a node-link graph keeps every field
    with its type, so that reading it again gives the same graph. As JSON, GraphML keeps every
    data field and loses what yEd draws.

    Raises:
        LabFileError: `lab_file.format`: a `lab.json` is written from a lab, and is no other
            format, because a rig knows neither devices nor contents. `lab_file.text`: an id, or
            the name of a field, has a character that GraphML cannot hold.
    """
    wanted = wanted or rig.format
    if wanted is rig.format and rig.text is not None:
        return rig.text.encode()
    if RigFormat.LABWEB in (wanted, rig.format):
        raise refuse("lab_file.format", f"a {rig.format} graph cannot be written as {wanted}")
    value = _value(rig)
    if wanted is RigFormat.NODE_LINK:
        return json.dumps(value, ensure_ascii=False, indent=2, allow_nan=False).encode()
    return _graphml(rig, value)


def _value(rig: Rig) -> dict[str, Any]:
    top = dict(rig.top)
    links_field = top.pop("links_field", "links")
    value: dict[str, Any] = {"nodes": [dict(element.attributes) for element in rig.elements]}
    if links_field is not None:
        value[links_field] = [dict(tube.attributes) for tube in rig.tubes]
    return value | top


def _graphml(rig: Rig, value: Mapping[str, Any]) -> bytes:
    root = Element("graphml", {"xmlns": GRAPHML})
    keys: dict[tuple[str, str, str], str] = {}
    graph = Element("graph", {"edgedefault": "directed", "id": "G"})
    for element in rig.elements:
        node = SubElement(graph, "node", {"id": element.key})
        _write_data(node, element.attributes, _FOR_NODES, keys)
    for tube in rig.tubes:
        ends = {"source": tube.source, "target": tube.target}
        own = {"id": str(tube.attributes["id"])} if "id" in tube.attributes else {}
        _write_data(SubElement(graph, "edge", own | ends), tube.attributes, _FOR_LINKS, keys)
    top = {name: part for name, part in value.items() if name != "nodes"}
    top.pop(str(rig.top.get("links_field")), None)
    _write_data(graph, {"top": top}, "graph", keys)
    for (owner, name, type_), key in keys.items():
        is_json = type_ == "json"
        attributes = {"id": key, "for": owner, "attr.name": name}
        SubElement(root, "key", attributes | {"attr.type": "string" if is_json else type_})
    root.append(graph)
    indent(root)
    text: str = tostring(root, encoding="unicode")
    if (unheld := _UNHELD.search(text)) is not None:
        around = text[max(0, unheld.start() - 20) : unheld.end()]
        message = f"GraphML cannot hold the last character of {around!r}: give it another name"
        raise refuse("lab_file.text", message)
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{text}".encode()


def _write_data(
    owner: Element,
    values: Mapping[str, Any],
    sort: str,
    keys: dict[tuple[str, str, str], str],
) -> None:
    for name, value in values.items():
        type_, text = _encode(value)
        number = len(keys)
        key = keys.setdefault(
            (sort, name, type_), f"{JSON_KEY if type_ == 'json' else 'd'}{number}"
        )
        SubElement(owner, "data", {"key": key}).text = text


def _encode(value: object) -> tuple[str, str]:
    """Return the type and text of a field; what plain text cannot hold is written as JSON."""
    if isinstance(value, bool):
        return "boolean", "true" if value else "false"
    if isinstance(value, int):
        return "long", str(value)
    if isinstance(value, float):
        return "double", repr(value)
    if isinstance(value, str) and value == value.strip() and value and _PLAIN.fullmatch(value):
        return "string", value
    return "json", json.dumps(value, ensure_ascii=True, allow_nan=False)
