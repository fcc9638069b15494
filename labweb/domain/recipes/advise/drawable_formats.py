"""Which graphs advice is drawn into."""

from __future__ import annotations

import json

from labweb.domain.graph.rig.node_classes import chemputer_sort
from labweb.domain.graph.rig.rig_model import Rig, RigFormat
from labweb.domain.graph.rig.rig_write import write_rig
from labweb.domain.recipes.advise.draw_chemputer_graph import Drawing
from labweb.domain.recipes.advise.draw_lab_file import LabDrawing
from labweb.domain.recipes.advise.draw_uni_lab_os_graph import UniDrawing


def draw_rig(rig: Rig, wanted: frozenset[str] = frozenset()) -> Drawing | None:
    """Copy a rig for drawing; None: nothing in it is joined.

    `wanted` are the reagents of the recipe, and flasks that are bound.
    """
    if not rig.tubes:
        return None
    if rig.format is RigFormat.LABWEB:
        return LabDrawing(json.loads(write_rig(rig)), wanted)
    is_chemputer = any(chemputer_sort(element.kind) for element in rig.elements)
    graph = json.loads(write_rig(rig, RigFormat.NODE_LINK))
    for node, element in zip(graph["nodes"], rig.elements, strict=True):
        node["id"] = element.key
    return Drawing(graph, wanted) if is_chemputer else UniDrawing(graph, wanted)
