"""XDL as JSON: the layout of the reference software, read and written.

```text
{"xdl", "metadata", "hardware": [{name, properties}], "parameters", "reagents", "steps":
 [{name, properties, children, section}], "blueprints": [{"id", …}]}
```

Comments are kept as `{"comment": text}` among the entries of a list, those that stand in no
list under `comments`; text that means nothing is `{"text": text}`. `uuid` of the reference is the
identity of one object in its memory and is not kept.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from labweb.domain.recipes.xdl.file_format.xml_tree import (
    MAX_BYTES,
    MAX_DEPTH,
    MAX_NODES,
    MAX_TEXT,
    Attribute,
    Comment,
    FilePlace,
    Instruction,
    Node,
    XmlDocument,
    XmlElement,
    XmlText,
    refuse,
)
from labweb.domain.recipes.xdl.tables.step_table import SECTIONS

_LISTS = {"hardware": "Hardware", "parameters": "Parameters", "reagents": "Reagents"}
_ENTRY = {"hardware": "Component", "parameters": "Parameter", "reagents": "Reagent"}
_TYPE_KEYS = {"component_type": "type", "parameter_type": "type"}
_KEYS = {
    "xdl",
    "comments",
    "id",
    "base_scale",
    "metadata",
    "steps",
    "blueprints",
    "attributes",
    *_LISTS,
}
_NOT_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_STEP_KEYS = {"name", "properties", "children", "uuid", "section", "comment"}


def parse_json(raw: bytes) -> XmlDocument:
    """Read the JSON form into the tree that the XML form gives.

    Raises:
        ProtocolError: `xdl.too_large`, `xdl.encoding`, `xdl.json`, `xdl.too_deep`, `xdl.too_many`,
            `xdl.text`, `xdl.json_layout`, with the path in the document.
    """
    value = _decoded(raw)
    if not isinstance(value, dict):
        raise refuse("xdl.json_layout", "the recipe is no JSON object")
    reader = _Reader()
    synthesis = reader.procedure(value, "Synthesis", "")
    blueprints = [
        reader.procedure(
            reader.object_of(item, f"blueprints[{i}]"), "Blueprint", f"blueprints[{i}]"
        )
        for i, item in enumerate(reader.list_of(value.get("blueprints"), "blueprints"))
    ]
    before: tuple[Node, ...] = ()
    if "xdl" in value:
        before = (Instruction("xdl", f'version="{reader.text(value["xdl"], "xdl")}"'),)
    root = XmlElement("XDL", (), (*blueprints, synthesis))
    return XmlDocument(root, before)


def _decoded(raw: bytes) -> object:
    if len(raw) > MAX_BYTES:
        raise refuse("xdl.too_large", f"the file has more than {MAX_BYTES} bytes")
    try:
        value: object = json.loads(raw.decode("utf-8-sig"), object_pairs_hook=_unique)
    except UnicodeDecodeError as error:
        raise refuse("xdl.encoding", f"byte {error.start} is not UTF-8") from error
    except json.JSONDecodeError as error:
        place = FilePlace(error.lineno, error.colno)
        raise refuse("xdl.json", f"not JSON: {error.msg} at {place}", place) from error
    except RecursionError as error:
        raise refuse("xdl.too_deep", "the JSON is nested too deep") from error
    except ValueError as error:
        raise refuse("xdl.json", "the file holds a number that is too long to be read") from error
    _check_bounds(value)
    return value


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise refuse("xdl.json", "a key stands twice in one object; which one counts is unknown")
    return found


def _check_bounds(value: object) -> None:
    level, count = [value], 0
    for _ in range(2 * MAX_DEPTH):
        count += len(level)
        if count > MAX_NODES:
            raise refuse("xdl.too_many", f"the file has more than {MAX_NODES} pieces")
        below: list[object] = []
        for item in level:
            if isinstance(item, str) and len(item) > MAX_TEXT:
                raise refuse("xdl.text", f"a text of more than {MAX_TEXT} characters")
            if isinstance(item, dict):
                below += item.values()
            elif isinstance(item, list):
                below += item
        if not below:
            return
        level = below
    raise refuse("xdl.too_deep", f"nested deeper than {MAX_DEPTH} elements")


class _Reader:
    """Builds elements and keeps the path of each."""

    def object_of(self, value: object, path: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise refuse("xdl.json_layout", f"{path} is no object", FilePlace(path=path))
        return value

    def list_of(self, value: object, path: str) -> list[Any]:
        if value is None:
            return []
        if not isinstance(value, list):
            raise refuse("xdl.json_layout", f"{path} is no list", FilePlace(path=path))
        return value

    def text(self, value: object, path: str) -> str:
        if isinstance(value, bool):
            return str(value)
        if isinstance(value, int | float):
            return str(value)
        if isinstance(value, str) and not _NOT_XML.search(value):
            return value
        raise refuse(
            "xdl.json_layout",
            f"{path} is no text that XML can hold, and no number",
            FilePlace(path=path),
        )

    def note(self, value: object, path: str) -> Comment | XmlText:
        if isinstance(value, dict) and set(value) == {"text"}:
            return XmlText(self.text(value["text"], path))
        text = self.text(value, path)
        if "--" in text or text.endswith("-"):
            message = f"the comment at {path} holds two hyphens, which XML cannot"
            raise refuse("xdl.json_layout", message, FilePlace(path=path))
        return Comment(text)

    def keys(self, value: Mapping[str, object], known: set[str], path: str) -> None:
        for key in value:
            if key not in known:
                at = f"{path}.{key}" if path else key
                message = f"the key {key!r:.60} means nothing at {path or 'the top'}"
                raise refuse("xdl.json_layout", message, FilePlace(path=at))

    def procedure(self, value: dict[str, Any], tag: str, path: str) -> XmlElement:
        self.keys(value, _KEYS, path)
        prefix = f"{path}." if path else ""
        notes = self.list_of(value.get("comments"), f"{prefix}comments")
        children: list[Node] = [self.note(note, f"{prefix}comments") for note in notes]
        metadata = self.attributes(value.get("metadata") or {}, f"{prefix}metadata")
        if metadata:
            children.append(
                XmlElement("Metadata", metadata, (), FilePlace(path=f"{prefix}metadata"))
            )
        # The sections stand in the order of the keys, as those do in that of the sections.
        for key, section in ((key, _LISTS[key]) for key in value if key in _LISTS):
            at = f"{prefix}{key}"
            entries = self.list_of(value.get(key), at)
            read = tuple(
                self.entry(item, _ENTRY[key], f"{at}[{i}]") for i, item in enumerate(entries)
            )
            if value.get(key) is not None:
                children.append(XmlElement(section, (), read, FilePlace(path=at)))
        at = f"{prefix}steps"
        steps = self.steps(self.list_of(value.get("steps"), at), at)
        scale = value.get("base_scale")
        own = (
            ()
            if scale is None
            else (Attribute("base_scale", self.text(scale, at), FilePlace(path=at)),)
        )
        children.append(XmlElement("Procedure", own, steps, FilePlace(path=at)))
        name = value.get("id")
        marks = self.attributes(value.get("attributes") or {}, f"{prefix}attributes")
        if name is not None:
            marks = (
                Attribute("id", self.text(name, f"{prefix}id"), FilePlace(path=f"{prefix}id")),
                *marks,
            )
        return XmlElement(tag, marks, tuple(children), FilePlace(path=path or "recipe"))

    def attributes(self, value: object, path: str) -> tuple[Attribute, ...]:
        found = []
        for key, content in self.object_of(value, path).items():
            if content is None:
                continue
            at = f"{path}.{key}"
            found.append(
                Attribute(_TYPE_KEYS.get(key, key), self.text(content, at), FilePlace(path=at))
            )
        return tuple(found)

    def entry(self, value: object, tag: str, path: str) -> Node:
        item = self.object_of(value, path)
        if set(item) in ({"comment"}, {"text"}):
            return self.note(item.get("comment", item), path)
        self.keys(item, {"name", "properties", "element"}, path)
        properties = self.attributes(item.get("properties") or {}, f"{path}.properties")
        named = self.text(item.get("element", tag), path)
        return XmlElement(named, properties, (), FilePlace(path=path))

    def steps(self, values: list[Any], path: str) -> tuple[Node, ...]:
        found: list[Node] = []
        section, held = "", list[Node]()
        for index, value in enumerate(values):
            item = self.object_of(value, f"{path}[{index}]")
            node = self.step(item, f"{path}[{index}]")
            own = str(item.get("section", "") or "")
            own = own if own in SECTIONS else ""
            if own != section:
                _close(section, held, found, path)
                section, held = own, []
            held.append(node)
        _close(section, held, found, path)
        return tuple(found)

    def step(self, item: dict[str, Any], path: str) -> Node:
        if len(set(item) - {"section"}) == 1 and ("comment" in item or "text" in item):
            plain = {key: content for key, content in item.items() if key != "section"}
            return self.note(plain.get("comment", plain), path)
        self.keys(item, _STEP_KEYS, path)
        name = self.text(item.get("name", ""), f"{path}.name")
        children = self.steps(self.list_of(item.get("children"), path), f"{path}.children")
        properties = self.attributes(item.get("properties") or {}, f"{path}.properties")
        return XmlElement(name or "step", properties, children, FilePlace(path=path))


def _close(section: str, held: list[Node], found: list[Node], path: str) -> None:
    if section and held:
        found.append(XmlElement(section, (), tuple(held), FilePlace(path=path)))
    else:
        found += held


def render_json(document: XmlDocument) -> str:
    """Write a tree in the JSON form.

    Raises:
        ProtocolError: `xdl.json_form`: it holds what the form has no place for.
    """
    root = document.root
    tops = [root] if root.tag == "Synthesis" else list(root.elements)
    syntheses = [top for top in tops if top.tag == "Synthesis"]
    if len(syntheses) != 1:
        message = f"the JSON form holds one synthesis, and the file has {len(syntheses)}"
        raise refuse("xdl.json_form", message, root.place)
    plain: dict[str, Any] = {}
    for node in document.before:
        if isinstance(node, Instruction) and node.target == "xdl":
            plain["xdl"] = node.text.partition("=")[2].strip().strip("\"'").split('"')[0]
    outside = (*document.before, *(root.children if root.tag == "XDL" else ()), *document.after)
    plain |= _procedure(syntheses[0], outside)
    blueprints = [_procedure(top) for top in tops if top.tag == "Blueprint"]
    if blueprints:
        plain["blueprints"] = blueprints
    return json.dumps(plain, indent=2, ensure_ascii=False) + "\n"


def _procedure(element: XmlElement, outside: tuple[Node, ...] = ()) -> dict[str, Any]:
    loose = [_noted(n) for n in (*outside, *element.children) if isinstance(n, Comment | XmlText)]
    plain: dict[str, Any] = {"comments": loose} if loose else {}
    marks = {a.name: a.value for a in element.attributes}
    if "id" in marks:
        plain["id"] = marks.pop("id")
    if marks:
        plain["attributes"] = marks
    names = {section: key for key, section in _LISTS.items()}
    for child in element.elements:
        if child.tag == "Metadata":
            plain["metadata"] = {a.name: a.value for a in child.attributes}
        elif child.tag in names:
            plain[names[child.tag]] = [_entry(node, names[child.tag]) for node in child.children]
        elif child.tag == "Procedure":
            if child.attributes:
                plain["base_scale"] = child.text_of("base_scale")
            plain["steps"] = _steps(child.children, "")
    return plain


def _entry(node: Node, key: str) -> dict[str, Any]:
    if not isinstance(node, XmlElement):
        return _note(node)
    entry: dict[str, Any] = {
        "name": node.text_of("name") or node.text_of("id"),
        "properties": {a.name: a.value for a in node.attributes},
    }
    return entry | ({} if node.tag == _ENTRY[key] else {"element": node.tag})


def _steps(nodes: tuple[Node, ...], section: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    mark = {"section": section} if section else {}
    for node in nodes:
        if not isinstance(node, XmlElement):
            found.append({**_note(node), **mark})
        elif node.tag in SECTIONS:
            found += _steps(node.children, node.tag)
        else:
            step: dict[str, Any] = {
                "name": node.tag,
                "properties": {a.name: a.value for a in node.attributes},
            }
            if node.children:
                step["children"] = _steps(node.children, "")
            found.append(step | mark)
    return found


def _note(node: Node) -> dict[str, Any]:
    noted = _noted(node)
    return noted if isinstance(noted, dict) else {"comment": noted}


def _noted(node: Node) -> str | dict[str, str]:
    if isinstance(node, XmlText):
        return {"text": node.text}
    return node.text if isinstance(node, Comment | Instruction) else ""
