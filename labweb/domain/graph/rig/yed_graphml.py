"""GraphML with what yEd draws: each node a box with its id for a label."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import (
    Element,
    SubElement,
    fromstring,
    indent,
    register_namespace,
    tostring,
)

from labweb.domain.graph.rig.graphml import GRAPHML, YED
from labweb.domain.graph.rig.rig_model import Rig, RigFormat
from labweb.domain.graph.rig.rig_write import write_rig

_BOX = {"width": "90.0", "height": "30.0"}
_PITCH = 140.0
_ROW = 8
_DRAWN = "yed"


def write_yed(rig: Rig) -> bytes:
    """Write a rig as GraphML that yEd opens and draws, with every field of nodes and links.

    A node stands where its `x` and `y` say, else on a grid.
    """
    register_namespace("", GRAPHML)
    register_namespace("y", YED)
    text = write_rig(_undrawn(rig), RigFormat.GRAPHML).decode()
    root = fromstring(text)  # noqa: S314 - written just now
    key = Element(f"{{{GRAPHML}}}key", {"id": _DRAWN, "for": "node", "yfiles.type": "nodegraphics"})
    root.insert(0, key)
    nodes = root.findall(f"{{{GRAPHML}}}graph/{{{GRAPHML}}}node")
    for place, (node, element) in enumerate(zip(nodes, rig.elements, strict=True)):
        data = SubElement(node, f"{{{GRAPHML}}}data", {"key": _DRAWN})
        shape = SubElement(data, f"{{{YED}}}ShapeNode")
        SubElement(shape, f"{{{YED}}}Geometry", {**_place(element.attributes, place), **_BOX})
        SubElement(shape, f"{{{YED}}}NodeLabel").text = element.key
    indent(root)
    found: str = tostring(root, encoding="unicode")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{found}\n".encode()


def _undrawn(rig: Rig) -> Rig:
    """Return the rig without the document that it was read from."""
    return Rig(RigFormat.NODE_LINK, rig.elements, rig.tubes, rig.defects, rig.top)


def _place(attributes: Mapping[str, object], number: int) -> dict[str, str]:
    found = {}
    rows = {"x": _PITCH * (number % _ROW), "y": _PITCH * (number // _ROW)}
    for axis, grid in rows.items():
        value = attributes.get(axis)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        found[axis] = str(value if is_number else grid)
    return found
