"""Read how labware of Opentrons finds its place on a slot, a module or other labware."""

from __future__ import annotations

from labweb.domain.resources.labware.foreign_json import FARTHEST_MM, JsonReader
from labweb.domain.resources.labware.labware_definition import Footprint, Seat, Vector

MAX_OFFSETS = 10_000

LID, FLAT_LEFT, FLAT_RIGHT = "tip_rack_lid", "flat_adapter_left", "flat_adapter_right"
"""Names of the joints that this module reads."""


def read_seat(reader: JsonReader, version: int, size: Vector, origin: Vector) -> Seat:
    """Return the seat; what is wrong becomes a finding.

    Args:
        reader: The definition.
        version: Of its schema.
        size: Box around the labware.
        origin: Origin of the definition, seen from the front left bottom corner of the box.
    """
    quirks = reader.optional_object("parameters").value.get("quirks")
    on_module = _offsets(reader, "stackingOffsetWithModule")
    gives_default = isinstance(quirks, list) and "providesStackingDefault" in quirks
    if version == 2:
        return Seat(
            corner_offset=reader.vector("cornerOffsetFromSlot"),
            on_labware=_offsets(reader, "stackingOffsetWithLabware"),
            on_module=on_module,
            gives_default=gives_default,
        )
    is_legacy = reader.has("legacyStackingOffsetWithLabware")
    key = "legacyStackingOffsetWithLabware" if is_legacy else "stackingOffsetWithLabware"
    features = reader.optional_object("features")
    gives, takes = _joints(features, size, origin)
    return Seat(
        on_labware=_offsets(reader, key),
        on_module=on_module,
        gives_default=is_legacy,
        footprint=_footprint(features, "slotFootprintAsChild", origin),
        platform=_footprint(features, "slotFootprintAsParent", origin),
        gives=gives,
        takes=takes,
        origin=origin,
    )


def _offsets(reader: JsonReader, key: str) -> dict[str, Vector]:
    if not reader.has(key):
        return {}
    return {
        name: Vector(*(offset.number(axis, -FARTHEST_MM) for axis in ("x", "y", "z")))
        for name, offset in reader.entries(key, MAX_OFFSETS)
    }


def _footprint(features: JsonReader, key: str, origin: Vector) -> Footprint | None:
    if not features.has(key):
        return None
    print_ = features.optional_object(key)
    back_left, front_right = (print_.optional_object(k) for k in ("backLeft", "frontRight"))
    spring = "springDirectionalForce"
    if print_.has(spring):
        print_.choice(spring, ("backLeftBottom",))
    return Footprint(
        left_mm=back_left.number("x", -FARTHEST_MM) + origin.x_mm,
        back_mm=back_left.number("y", -FARTHEST_MM) + origin.y_mm,
        right_mm=front_right.number("x", -FARTHEST_MM) + origin.x_mm,
        front_mm=front_right.number("y", -FARTHEST_MM) + origin.y_mm,
        z_mm=print_.number("z", -FARTHEST_MM) + origin.z_mm,
        is_pushed_to_back_left=print_.has(spring),
    )


def _joints(
    features: JsonReader, size: Vector, origin: Vector
) -> tuple[dict[str, Vector], dict[str, Vector]]:
    """Return the points at which others join it, and those by which it joins others."""
    gives: dict[str, Vector] = {}
    takes: dict[str, Vector] = {}
    for key, points in (("AsParent", gives), ("AsChild", takes)):
        name = f"opentronsFlexTipRackLid{key}"
        if features.has(name):
            z = features.optional_object(name).number("matingZ", -FARTHEST_MM)
            points[LID] = origin.plus(Vector(0.0, 0.0, z))
    middle = Vector(0.0, size.y_mm / 2, origin.z_mm)
    if features.has("heaterShakerUniversalFlatAdapter"):
        adapter = features.optional_object("heaterShakerUniversalFlatAdapter")
        z = adapter.number("flatSupportThermalCouplingZ", -FARTHEST_MM)
        left, right = (
            adapter.optional_object(side).number("wallX", -FARTHEST_MM)
            for side in ("deckLeft", "deckRight")
        )
        gives[FLAT_LEFT] = middle.plus(Vector(left, 0.0, z))
        gives[FLAT_RIGHT] = middle.plus(Vector(size.x_mm + right, 0.0, z))
    if features.has("flatSupportThermalCouplingAsChild"):
        coupling = features.optional_object("flatSupportThermalCouplingAsChild")
        z = coupling.number("wellExteriorBottomZ", -FARTHEST_MM)
        takes[FLAT_LEFT] = middle.plus(Vector(0.0, 0.0, z))
        takes[FLAT_RIGHT] = middle.plus(Vector(size.x_mm, 0.0, z))
    return gives, takes
