"""Geometry: plain solids, and the parametric bodies of each kind built from them."""

from twin.meshes.forms import (
    Form,
    Piece,
    axis_of,
    body,
    inside_of,
    liquid,
    plunger,
    probe,
    state_ring,
    syringe_axis,
)
from twin.meshes.solids import Mesh

__all__ = [
    "Form",
    "Mesh",
    "Piece",
    "axis_of",
    "body",
    "inside_of",
    "liquid",
    "plunger",
    "probe",
    "state_ring",
    "syringe_axis",
]
