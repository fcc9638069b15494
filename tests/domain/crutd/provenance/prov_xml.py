"""PROV-XML of the corpus as PROV-JSON: names and values as they stand, nothing judged."""

from __future__ import annotations

import json
from itertools import count
from pathlib import Path
from typing import Any

from lxml import etree  # type: ignore[import-untyped]

PROV = "{http://www.w3.org/ns/prov#}"
XSI = "{http://www.w3.org/2001/XMLSchema-instance}"


def to_json(path: Path) -> bytes:
    """Translate a file; each record without a name gets a blank one."""
    root = etree.fromstring(path.read_bytes(), etree.XMLParser(remove_comments=True))
    return json.dumps(_content(root, count())).encode()


def _content(element: Any, numbers: Any) -> dict[str, Any]:  # noqa: ANN401 - lxml has no types
    found: dict[str, Any] = {
        "prefix": {prefix: space for prefix, space in element.nsmap.items() if prefix}
    }
    for child in element:
        kind = etree.QName(child).localname
        name = child.get(f"{PROV}id") or f"_:n{next(numbers)}"
        if kind == "bundle":
            found.setdefault("bundle", {})[name] = _content(child, numbers)
        else:
            found.setdefault(kind, {}).setdefault(name, []).append(_record(child))
    return found


def _record(element: Any) -> dict[str, Any]:  # noqa: ANN401
    record: dict[str, Any] = {}
    for child in element:
        name = f"{child.prefix}:{etree.QName(child).localname}"
        reference, kind = child.get(f"{PROV}ref"), child.get(f"{XSI}type")
        if reference is not None:
            record[name] = reference
        elif kind is not None:
            record.setdefault(name, []).append({"$": child.text or "", "type": kind})
        elif name in {"prov:time", "prov:startTime", "prov:endTime"}:
            record[name] = child.text
        else:
            record.setdefault(name, []).append(child.text or "")
    return record
