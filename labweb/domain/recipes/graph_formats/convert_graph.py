"""A physical graph in another format, and everything that the format cannot hold."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from labweb.domain.canonical_json import canonical
from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.graph_write import export_uni_lab_os
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.rig.graphml import YED
from labweb.domain.graph.rig.node_classes import chemputer_sort
from labweb.domain.graph.rig.rig_model import Rig, RigFormat
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.graph.rig.rig_write import write_rig
from labweb.domain.graph.rig.yed_graphml import write_yed
from labweb.domain.recipes.graph_formats.conversion_loss import (
    CHEMPUTER,
    LABWEB,
    UNI_LAB_OS,
    lost,
    unheld,
)
from labweb.domain.recipes.graph_formats.from_chemputer import from_chemputer
from labweb.domain.recipes.graph_formats.to_chemputer import to_chemputer

_CARRIED = "chemputer"


class Target(StrEnum):
    """A format that graphs are written in."""

    LABWEB = "labweb"
    CHEMPUTER = "chemputer"
    CHEMPUTER_GRAPHML = "chemputer-graphml"
    CHEMPUTER_YED = "chemputer-yed"
    UNI_LAB_OS = "uni-lab-os"
    UNI_LAB_OS_GRAPHML = "uni-lab-os-graphml"

    @property
    def family(self) -> str:
        """Return whose graphs these are."""
        return self.value.removesuffix("-graphml").removesuffix("-yed")


@dataclass(frozen=True, slots=True)
class Converted:
    """A graph as it is written, and what is not in it."""

    raw: bytes
    findings: tuple[Finding, ...]
    """`graph.not_held`, one for each entry; none: reading it again gives all that was said."""


def convert(raw: bytes, target: Target, name: str) -> Converted:
    """Write a graph in another format.

    Args:
        raw: A graph of a Chemputer or of Uni-Lab-OS (JSON, GraphML), or a `lab.json`; hostile
            until read.
        target: How it is to be written.
        name: What a lab is called that comes of a graph without a name.

    Raises:
        LabFileError: It cannot be read, or what would be written is no lab; `findings` list why.
    """
    rig = read_rig(raw)
    family = family_of(rig)
    if family == target.family:
        return _same_family(rig, target, raw)
    value, findings = _crossed(rig, family, target, name)
    if target is Target.LABWEB:
        return Converted(_lab_bytes(value), tuple(findings))
    graph = json.dumps(value, ensure_ascii=False, indent=2, allow_nan=False).encode() + b"\n"
    return Converted(_in_syntax(graph, target), tuple(findings))


def family_of(rig: Rig) -> str:
    """Return whose format a graph is in: `labweb`, `chemputer` or `uni-lab-os`."""
    if rig.format is RigFormat.LABWEB:
        return Target.LABWEB.value
    is_chemputer = any(chemputer_sort(element.kind) for element in rig.elements)
    return Target.CHEMPUTER.value if is_chemputer else Target.UNI_LAB_OS.value


def _same_family(rig: Rig, target: Target, raw: bytes) -> Converted:
    if target is Target.LABWEB:
        return Converted(raw, ())
    if target is Target.CHEMPUTER_YED:
        is_drawn = rig.text is not None and YED in rig.text
        return Converted(raw if is_drawn else write_yed(rig), ())
    wanted = RigFormat.GRAPHML if target.value.endswith("-graphml") else RigFormat.NODE_LINK
    findings = []
    if rig.text is not None and YED in rig.text and wanted is not RigFormat.GRAPHML:
        findings = [lost("the drawing", "what yEd draws is no field of a node", target.value)]
    return Converted(write_rig(rig, wanted), tuple(findings))


def _crossed(
    rig: Rig, family: str, target: Target, name: str
) -> tuple[dict[str, Any], list[Finding]]:
    """Return the plain data of another family's graph."""
    if target.family == Target.CHEMPUTER.value:
        return _to_chemputer(rig, family)
    if family == Target.UNI_LAB_OS.value:
        lab = read_uni_lab_os(write_rig(rig, RigFormat.NODE_LINK), name)
        notes = [lost(note.subject, note.message, LABWEB) for note in lab.notes]
        value: dict[str, Any] = json.loads(render_lab(lab))
        return value, notes
    if family == Target.LABWEB.value:
        value = json.loads(rig.text or "")
        return _to_uni(value), [*_unheld_by_uni(value)]
    value, findings = from_chemputer(rig, name)
    if target is Target.LABWEB:
        carried = json.loads(write_rig(rig, RigFormat.NODE_LINK))
        return {
            **value,
            "extra": {_CARRIED: {"graph": carried, "of": _digest(value, carried)}},
        }, findings
    return _to_uni(value), [*findings, *_unheld_by_uni(value)]


def _to_uni(value: Mapping[str, Any]) -> dict[str, Any]:
    return export_uni_lab_os(read_lab(_lab_bytes(value)))


def _lab_bytes(value: Mapping[str, Any]) -> bytes:
    """Return a lab file, once it is one.

    Raises:
        LabFileError: It is none; `findings` list why.
    """
    raw = json.dumps(value, ensure_ascii=False, indent=2, allow_nan=False).encode() + b"\n"
    return render_lab(read_lab(raw))


def _digest(value: Mapping[str, Any], carried: object) -> str:
    """Return the SHA-256 of a lab as it is read back, and of the graph that it carries beside."""
    body: dict[str, Any] = json.loads(_lab_bytes({**value, "extra": {}}))
    return hashlib.sha256(canonical({"lab": body, "graph": carried})).hexdigest()


def _carried_by(lab: Mapping[str, Any]) -> tuple[dict[str, Any] | None, list[Finding]]:
    """Return the graph that a lab came of; None: it came of none, or either was changed since."""
    carried = (lab.get("extra") or {}).get(_CARRIED)
    if carried is None:
        return None, []
    graph = carried.get("graph") if isinstance(carried, Mapping) else None
    try:
        rig = read_rig(json.dumps(graph).encode())
    except LabError as error:
        return None, [_not_carried(error.message)]
    if family_of(rig) != Target.CHEMPUTER.value or not isinstance(graph, dict):
        return None, [_not_carried("it is of no Chemputer")]
    return (graph if carried.get("of") == _digest(lab, graph) else None), []


def _not_carried(reason: str) -> Finding:
    what = f"the graph that the lab carries is none ({reason}), so it is written by its classes"
    return lost(f"extra.{_CARRIED}", what, CHEMPUTER)


def _to_chemputer(rig: Rig, family: str) -> tuple[dict[str, Any], list[Finding]]:
    """Write by classes; a lab that came of such a graph and was not changed gives it back."""
    if family == Target.UNI_LAB_OS.value:
        value, findings = to_chemputer(rig)
        said = frozenset({"id", "name", "class", "type", "config.max_volume", "data.liquids"})
        said |= {"data.liquid", "config.positions", "config.min_temp", "config.max_temp"}
        known = {str(node["id"]) for node in value["nodes"]}
        for element in (one for one in rig.elements if one.key in known):
            findings += unheld(element.key, element.attributes, said, CHEMPUTER)
        return value, findings
    lab: dict[str, Any] = json.loads(rig.text or "")
    graph, odd = _carried_by(lab)
    if graph is not None:
        return graph, []
    value, findings = to_chemputer(rig)
    known = {node["id"] for node in value["nodes"]}
    return value, [*odd, *findings, *_unheld_by_chemputer(lab, known)]


def _in_syntax(graph: bytes, target: Target) -> bytes:
    if target is Target.CHEMPUTER_YED:
        return write_yed(read_rig(graph))
    is_xml = target.value.endswith("-graphml")
    return write_rig(read_rig(graph), RigFormat.GRAPHML) if is_xml else graph


_WHOLE = frozenset({"schema", "resources", "connections", "materials", "lots", "devices", "hosts"})
_UNI_MEDIA = frozenset(
    one.value
    for one in (
        Medium.LIQUID,
        Medium.THERMAL,
        Medium.MECHANICAL,
        Medium.COMMUNICATION,
        Medium.TRANSPORT,
    )
)


def _unheld_by_uni(lab: Mapping[str, Any]) -> Iterator[Finding]:
    yield from unheld("the lab", {**lab, "extra": None}, _WHOLE, UNI_LAB_OS)
    yield from _unheld_of_matter(lab, UNI_LAB_OS)
    held = frozenset({"key", "name", "kind", "parent", "contents", "config", "data", "extra"})
    for one in lab["resources"]:
        outer = {name: value for name, value in one.items() if name not in ("config", "data")}
        yield from unheld(one["key"], outer, held, UNI_LAB_OS)
    for one in lab.get("connections", ()):
        if one.get("extra"):
            continue  # It came of such a graph.
        if one["medium"] not in _UNI_MEDIA:
            text = f"links there say nothing of {one['medium']}; it is written as logical"
            yield lost(one["key"], text, UNI_LAB_OS)
        if not one["is_two_way"]:
            yield lost(one["key"], "a link there has no direction", UNI_LAB_OS)
        held = frozenset({"key", "source", "target", "medium", "is_two_way"})
        yield from unheld(one["key"], one, held, UNI_LAB_OS)


def _unheld_of_matter(lab: Mapping[str, Any], target: str) -> Iterator[Finding]:
    for sort, held in (("materials", {"key"}), ("lots", {"key", "material"})):
        for one in lab.get(sort, ()):
            entry = {**one, "name": None if one.get("name") == one["key"] else one.get("name")}
            yield from unheld(one["key"], entry, frozenset(held), target)
    for sort in ("hosts", "devices"):
        for one in lab.get(sort, ()):
            yield lost(one["key"], f"{target} does not hold {sort}", target)


_CHEMPUTER_CONFIG = ("capacity_ul", "gas", "filling", "common_port", "ports_count")


def _unheld_by_chemputer(lab: Mapping[str, Any], known: set[str]) -> Iterator[Finding]:
    yield from unheld("the lab", {**lab, "extra": None}, _WHOLE, CHEMPUTER)
    yield from _unheld_of_matter(lab, CHEMPUTER)
    held = frozenset({"key", "kind", "contents"})
    held |= {f"config.{name}" for name in _CHEMPUTER_CONFIG}
    held |= {"config.min_temperature_c", "config.max_temperature_c"}
    for one in (entry for entry in lab["resources"] if entry["key"] in known):
        entry = {**one, "name": None if one["name"] == one["key"] else one["name"]}
        yield from unheld(one["key"], entry, held, CHEMPUTER)
    for one in lab.get("connections", ()):
        held = frozenset({"key", "source", "target", "medium", "is_two_way", "dead_volume_ul"})
        yield from unheld(one["key"], one, held, CHEMPUTER)
