"""A piece of labware as a definition describes it, whoever wrote the definition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from labweb.domain.errors import NotFoundError
from labweb.domain.resources.labware.well_geometry import Cavity


class Vector(NamedTuple):
    """A place or a shift in millimetres: x right, y to the back, z up."""

    x_mm: float
    y_mm: float
    z_mm: float

    def plus(self, other: Vector) -> Vector:
        """Return the sum."""
        return Vector(self.x_mm + other.x_mm, self.y_mm + other.y_mm, self.z_mm + other.z_mm)

    def minus(self, other: Vector) -> Vector:
        """Return the difference."""
        return Vector(self.x_mm - other.x_mm, self.y_mm - other.y_mm, self.z_mm - other.z_mm)


ZERO = Vector(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TipDefinition:
    """The tips that a rack is made for."""

    length_mm: float
    overlap_mm: float | None = None
    """How far a nozzle goes in; None is unknown."""

    capacity_nl: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WellDefinition:
    """One cavity, or one place for a tip.

    Frame:
        Front left bottom corner of the labware. `bottom` is the middle of the floor.
    """

    address: str
    """`A1`."""

    bottom: Vector
    x_size_mm: float
    y_size_mm: float
    depth_mm: float
    is_round: bool
    capacity_nl: int | None = None
    """None: the definition does not say, so nothing is poured in."""

    cavity: Cavity | None = None
    """Shape of the inside; None is unknown."""

    @property
    def top(self) -> Vector:
        """Middle of the opening."""
        return self.bottom.plus(Vector(0.0, 0.0, self.depth_mm))

    @property
    def corner(self) -> Vector:
        """Front left bottom corner of the box around the cavity."""
        return self.bottom.minus(Vector(self.x_size_mm / 2, self.y_size_mm / 2, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Footprint:
    """The rectangle by which labware stands, or on which other labware stands."""

    left_mm: float
    back_mm: float
    right_mm: float
    front_mm: float
    z_mm: float
    is_pushed_to_back_left: bool = False
    """A spring holds what stands there against the left and the back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seat:
    """How labware finds its place on what carries it, and carries others."""

    corner_offset: Vector = ZERO
    """Shift of the frame against the corner of the slot; counts for the topmost labware only."""

    on_labware: Mapping[str, Vector] = field(default_factory=dict)
    """Overlap with the labware below, by its name; `default` is any other."""

    on_module: Mapping[str, Vector] = field(default_factory=dict)
    """Overlap with the module below, by its model."""

    gives_default: bool = False
    """Its own `default` overlap serves whatever stands on it."""

    footprint: Footprint | None = None
    """By which it stands in a slot; None where the format has no such thing."""

    platform: Footprint | None = None
    """On which other labware stands."""

    gives: Mapping[str, Vector] = field(default_factory=dict)
    """Points at which a part of that name may join it from above."""

    takes: Mapping[str, Vector] = field(default_factory=dict)
    """Points of its own that come to lie on those of what carries it."""

    origin: Vector | None = None
    """Origin that its offsets count from; None: our own, the front left bottom corner."""


@dataclass(frozen=True, kw_only=True)
class LabwareDefinition:
    """One model of labware. Positions count from its front left bottom corner."""

    name: str
    """Under which others refer to it, such as `corning_96_wellplate_360ul_flat`."""

    label: str
    """What a person calls it."""

    kind: str
    """Of our list of kinds."""

    well_kind: str | None
    """Kind of what lies in it; None: nothing of it is a place or a vessel."""

    source: str
    """Format and version that it was read from, such as `opentrons/2`."""

    size: Vector
    wells: tuple[WellDefinition, ...]
    """Column by column, from the back left."""

    tip: TipDefinition | None = None
    seat: Seat = field(default_factory=Seat)

    @cached_property
    def wells_by_address(self) -> dict[str, WellDefinition]:
        """Well by its address."""
        return {well.address: well for well in self.wells}

    def find_well(self, address: str) -> WellDefinition:
        """Return the well.

        Raises:
            NotFoundError: It has no such well.
        """
        try:
            return self.wells_by_address[address]
        except KeyError:
            raise NotFoundError(
                f"{self.label} has no well {address!r}", code="labware.no_well"
            ) from None
