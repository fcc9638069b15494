"""Lab files of any format as a lab: told apart by what is in them, read, and bound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from typing import Any
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.apply_binding import apply_binding
from labweb.domain.graph.lab_file.binding_file import BindingFile
from labweb.domain.graph.lab_file.lab_json_read import read_decoded
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from labweb.domain.graph.lab_file.untrusted_json import decode_json
from labweb.domain.graph.rig.lab_as_rig import is_lab
from labweb.domain.graph.rig.node_classes import chemputer_sort
from labweb.domain.graph.rig.rig_model import Rig, RigFormat
from labweb.domain.graph.rig.rig_read import is_graphml, read_rig, unpacked
from labweb.domain.graph.rig.rig_write import write_rig
from labweb.domain.recipes.graph_formats.from_chemputer import from_chemputer
from labweb.domain.resources.resource import Resource

_EVAPORATOR = "rotary_evaporator"


class Format(StrEnum):
    """A format of lab files."""

    LABWEB = "labweb"
    """labweb's own `lab.json`."""

    UNI_LAB_OS = "uni_lab_os"
    """Graph of Uni-Lab-OS, node-link JSON or GraphML."""

    CHEMPUTER = "chemputer"
    """Graph of a Chemputer, node-link JSON or GraphML."""


class LabDocument:
    """A lab file that was decoded once, and whose format is known."""

    def __init__(self, raw: bytes, name: str) -> None:
        """Decode a file, packed with gzip or not; `name` is used where it has none.

        Raises:
            LabFileError: The file is neither JSON nor GraphML that is read at all.
        """
        self._name = name
        self._raw = unpacked(raw)
        self._rig: Rig | None = None
        self._value: object = None
        if is_graphml(self._raw):
            self._rig = read_rig(self._raw)
            self._raw = write_rig(self._rig, RigFormat.NODE_LINK)
        self._value = decode_json(self._raw)
        self.format = self._detect()

    def _detect(self) -> Format:
        if is_lab(self._value):
            return Format.LABWEB
        is_chemputer = any(chemputer_sort(one) for one in self.classes().values())
        return Format.CHEMPUTER if is_chemputer else Format.UNI_LAB_OS

    def classes(self) -> dict[str, str]:
        """Return the class of each node of a graph, by its id."""
        nodes = self._value.get("nodes") if isinstance(self._value, Mapping) else None
        found = [one for one in nodes or () if isinstance(one, Mapping)]
        return {str(one.get("id")): str(one.get("class") or "") for one in found}

    def read(self) -> LabFile:
        """Read it by the reader that should take it, or says best why it cannot.

        Raises:
            LabFileError: As the reader of its format.
        """
        if self.format is Format.CHEMPUTER:
            return self._of_chemputer()[0]
        if self.format is Format.LABWEB:
            return read_decoded(self._value)
        return read_uni_lab_os(self._raw, self._name)

    def bound(self, binding: BindingFile) -> tuple[LabFile, tuple[Finding, ...]]:
        """Read it, and give it the kinds and devices of a binding.

        Returns:
            As `apply_binding`.

        Raises:
            LabFileError: As the reader of its format, or the result would be no lab.
        """
        if self.format is Format.CHEMPUTER:
            lab, rig = self._of_chemputer()
            return apply_binding(lab, binding, _nodes(lab, rig))
        return apply_binding(self.read(), binding)

    def _of_chemputer(self) -> tuple[LabFile, Rig]:
        rig = self._rig or read_rig(self._raw)
        value, _ = from_chemputer(rig, self._name)
        return replace(read_decoded(value), notes=rig.defects), rig


def _nodes(lab: LabFile, rig: Rig) -> dict[UUID, Mapping[str, Any]]:
    """Return the node of each resource; an evaporator has that of the flask that turns on it."""
    nodes = {element.key: element.attributes for element in rig.elements}
    return {
        resource.id: nodes[_origin(lab, resource)]
        for resource in lab.resources
        if _origin(lab, resource) in nodes and not _turns(lab, resource)
    }


def _origin(lab: LabFile, resource: Resource) -> str:
    turning = lab.tree.children.get(resource.id, ()) if resource.kind == _EVAPORATOR else ()
    return turning[0].key if turning else resource.key


def _turns(lab: LabFile, resource: Resource) -> bool:
    parent = None if resource.parent_id is None else lab.tree.by_id[resource.parent_id]
    return parent is not None and parent.kind == _EVAPORATOR
