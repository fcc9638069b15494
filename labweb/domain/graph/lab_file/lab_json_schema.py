"""The JSON Schema that describes `lab.json` to people and editors."""

from __future__ import annotations

from typing import Any

import msgspec

from labweb.domain.graph.lab_file.lab_json_entries import (
    ConnectionEntry,
    ContentsEntry,
    DeviceFileEntry,
    HostFileEntry,
    LotEntry,
    MassEntry,
    MaterialEntry,
    PoseEntry,
    ResourceEntry,
    TopEntry,
)
from labweb.domain.graph.lab_file.resource_config import config_schema
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.resource_kinds import KINDS

_ITEMS: dict[str, type[msgspec.Struct]] = {
    "materials": MaterialEntry,
    "lots": LotEntry,
    "resources": ResourceEntry,
    "connections": ConnectionEntry,
    "hosts": HostFileEntry,
    "devices": DeviceFileEntry,
}


def lab_schema() -> dict[str, Any]:
    """Return the schema of the file format, as `lab.schema.json` ships it."""
    configs = {kind: schema for kind in KINDS if (schema := config_schema(kind)) is not None}
    types = [
        TopEntry,
        *_ITEMS.values(),
        ContentsEntry,
        MassEntry,
        PoseEntry,
        *set(configs.values()),
    ]
    _, definitions = msgspec.json.schema_components(types, ref_template="#/$defs/{name}")
    for name, entry in _ITEMS.items():
        definitions["TopEntry"]["properties"][name]["items"] = _ref(entry)
    resource = definitions["ResourceEntry"]
    resource["properties"]["contents"]["items"] = _ref(ContentsEntry)
    resource["properties"]["masses"]["items"] = _ref(MassEntry)
    resource["properties"]["pose"] = {"anyOf": [_ref(PoseEntry), {"type": "null"}]}
    resource["properties"]["kind"] = {"enum": list(KINDS)}
    resource["allOf"] = [
        {
            "if": {"properties": {"kind": {"const": kind}}},
            "then": {"properties": {"config": _ref(schema)}},
        }
        for kind, schema in configs.items()
    ]
    definitions["ConnectionEntry"]["properties"]["medium"] = {"enum": list(Medium)}
    device = definitions["DeviceFileEntry"]
    device["oneOf"] = [
        {"properties": {"transport": {"type": "string"}, "simulator": {"type": "null"}}}
        | {"required": ["transport"]},
        {"properties": {"transport": {"type": "null"}, "simulator": {"type": "object"}}}
        | {"required": ["simulator"]},
    ]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:labweb:lab:1",
        "title": "labweb lab file",
        **_ref(TopEntry),
        "$defs": {name: definitions[name] for name in sorted(definitions)},
    }


def _ref(entry: type[msgspec.Struct]) -> dict[str, Any]:
    return {"$ref": f"#/$defs/{entry.__name__}"}
