"""What a person asks for when they calibrate a device, and whether it can be asked."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import date
from typing import Annotated
from uuid import UUID

import msgspec
from msgspec import Meta

from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.calibration.gravimetric_volume import (
    LEAST_REPEATS,
    LEVELS_RATIO,
    MOST_REPEATS,
    Surroundings,
    check_surroundings,
)
from labweb.domain.calibration.ph_buffers_table import BUFFERS
from labweb.domain.calibration.thermometer_comparison import LEAST_SET_POINTS, MOST_SET_POINTS
from labweb.domain.errors import Finding

LONGEST_DAYS = 1095
"""Three years: the longest time that any calibration is believed."""

LONGEST_SETTLE_S = 7200.0

_Name = Annotated[str, Meta(max_length=200)]


class Reference(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The standard that the device is compared with."""

    name: _Name
    certificate: _Name
    """Number of its certificate, or lot of a buffer."""

    expanded: float
    """Its expanded uncertainty (k = 2) by the certificate: mg of a balance, pH, °C."""

    due_on: date
    """Until when the certificate holds."""


class VolumeOrder(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Weigh the water that a pump moves."""

    source_id: UUID
    """Vessel with water."""

    target_id: UUID
    """Vessel on the balance."""

    balance_id: UUID
    """Device that weighs."""

    around: Surroundings
    reference: Reference
    repeats: Annotated[int, Meta(ge=0, le=1000)] = LEAST_REPEATS
    tolerance: float = 0.005
    """Largest expanded uncertainty, as a share of the volume."""

    valid_days: Annotated[int, Meta(ge=0, le=1_000_000)] = 365

    @property
    def quantity(self) -> CalibrationQuantity:
        """Tell what is calibrated."""
        return CalibrationQuantity.VOLUME

    @property
    def vessel_ids(self) -> list[UUID]:
        """Name every vessel that it takes."""
        return [self.source_id, self.target_id]

    @property
    def device_id(self) -> UUID:
        """Name the device that it takes beside the one that is calibrated."""
        return self.balance_id


class Buffer(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One buffer, in the vessel from which it is pumped."""

    source_id: UUID
    standard: _Name
    """Key of the table of standard buffers: its pH follows from its temperature."""

    reference: Reference


class PhOrder(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Read a probe in buffers that are pumped to it, one after the other."""

    buffers: Annotated[list[Buffer], Meta(max_length=20)]
    vessel_id: UUID
    """Vessel that the probe dips into; empty before and after."""

    waste_id: UUID
    pump_id: UUID
    """Device that moves the buffers."""

    volume_ul: float
    """Of each filling; as much of each buffer rinses the vessel before."""

    settle_s: float = 30.0
    """How long the probe stands in a buffer before it is read."""

    repeats: Annotated[int, Meta(ge=0, le=1000)] = 3
    tolerance: float = 0.1
    """Largest expanded uncertainty, in pH."""

    valid_days: Annotated[int, Meta(ge=0, le=1_000_000)] = 7

    @property
    def quantity(self) -> CalibrationQuantity:
        """Tell what is calibrated."""
        return CalibrationQuantity.PH

    @property
    def vessel_ids(self) -> list[UUID]:
        """Name every vessel that it takes."""
        return [self.vessel_id, self.waste_id, *(one.source_id for one in self.buffers)]

    @property
    def device_id(self) -> UUID:
        """Name the device that it takes beside the one that is calibrated."""
        return self.pump_id


class TemperatureOrder(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Hold a heater at set points and read a reference thermometer beside its own probe."""

    vessel_id: UUID
    """Vessel that the device heats, with liquid in which both thermometers stand."""

    thermometer_id: UUID
    """Device that is the reference."""

    reference: Reference
    set_points_c: Annotated[list[float], Meta(max_length=100)]
    """Held from the lowest up: what only heats does not chill."""

    settle_s: float = 300.0
    """How long a set point is held before each reading."""

    repeats: Annotated[int, Meta(ge=0, le=1000)] = 3
    stir_speed_rpm: float | None = None
    """None: nothing stirs."""

    tolerance: float = 0.5
    """Largest expanded uncertainty, in K."""

    valid_days: Annotated[int, Meta(ge=0, le=1_000_000)] = 365

    @property
    def quantity(self) -> CalibrationQuantity:
        """Tell what is calibrated."""
        return CalibrationQuantity.TEMPERATURE

    @property
    def vessel_ids(self) -> list[UUID]:
        """Name every vessel that it takes."""
        return [self.vessel_id]

    @property
    def device_id(self) -> UUID:
        """Name the device that it takes beside the one that is calibrated."""
        return self.thermometer_id


Order = VolumeOrder | PhOrder | TemperatureOrder


def check_temperature_order(order: TemperatureOrder, *, today: date) -> list[Finding]:
    """List everything that keeps an order from being carried out; empty means go."""
    found = _check_reference(order.reference, today)
    count = len(set(order.set_points_c))
    if not LEAST_SET_POINTS <= count == len(order.set_points_c) <= MOST_SET_POINTS:
        text = (
            f"{count} different set points; {LEAST_SET_POINTS} to {MOST_SET_POINTS} are held, each "
            "named once"
        )
        found.append(Finding("calibration.too_few_points", text, "set_points_c"))
    if not 2 <= order.repeats <= MOST_REPEATS:
        text = f"{order.repeats} readings; 2 to {MOST_REPEATS} are taken at each set point"
        found.append(Finding("calibration.too_few_points", text, "repeats"))
    if not 0 < order.tolerance <= 10:
        text = f"a tolerance of {order.tolerance:g} K; more than nothing and at most 10 K is asked"
        found.append(Finding("calibration.tolerance", text, "tolerance"))
    if not 0 < order.settle_s <= LONGEST_SETTLE_S:
        text = f"a set point is held for up to {LONGEST_SETTLE_S:g} s before each reading"
        found.append(Finding("calibration.settling", text, "settle_s"))
    return found + _check_days(order.valid_days)


def check_ph_order(order: PhOrder, *, today: date) -> list[Finding]:
    """List everything that keeps an order from being carried out; empty means go."""
    found = []
    names = [one.standard for one in order.buffers]
    if not 2 <= len(set(names)) == len(names) <= 3:
        text = f"{len(set(names))} different buffers; a probe is calibrated in two or three"
        found.append(Finding("calibration.too_few_points", text, "buffers"))
    for one in order.buffers:
        found += _check_reference(one.reference, today)
        if one.standard not in BUFFERS:
            text = f"{one.standard!r} is no standard buffer: one of {', '.join(BUFFERS)}"
            found.append(Finding("calibration.unknown_buffer", text, "buffers"))
    if not 2 <= order.repeats <= MOST_REPEATS:
        text = f"{order.repeats} readings; 2 to {MOST_REPEATS} are taken in each buffer"
        found.append(Finding("calibration.too_few_points", text, "repeats"))
    if not 0 < order.tolerance <= 1:
        text = f"a tolerance of {order.tolerance:g}; more than nothing and at most pH 1 is asked"
        found.append(Finding("calibration.tolerance", text, "tolerance"))
    if not (order.volume_ul > 0 and 0 < order.settle_s <= 3600):
        text = "a filling is more than nothing, and the probe rests in it up to an hour"
        found.append(Finding("calibration.filling", text, "volume_ul"))
    return found + _check_days(order.valid_days)


def check_order(order: VolumeOrder, *, today: date) -> list[Finding]:
    """List everything that keeps an order from being carried out; empty means go."""
    found = [*check_surroundings(order.around), *_check_reference(order.reference, today)]
    if not LEAST_REPEATS <= order.repeats <= MOST_REPEATS:
        text = f"{order.repeats} repeats; {LEAST_REPEATS} to {MOST_REPEATS} are weighed per level"
        found.append(Finding("calibration.too_few_points", text, "repeats"))
    if not 0 < order.tolerance <= 0.1:
        text = f"a tolerance of {order.tolerance:.3%}; more than nothing and at most 10 % is asked"
        found.append(Finding("calibration.tolerance", text, "tolerance"))
    return found + _check_days(order.valid_days)


def _check_days(days: int) -> list[Finding]:
    if 1 <= days <= LONGEST_DAYS:
        return []
    text = f"valid for {days} days; a calibration lasts 1 to {LONGEST_DAYS} days"
    return [Finding("calibration.validity", text, "valid_days")]


def _check_reference(reference: Reference, today: date) -> list[Finding]:
    found = []
    if not reference.name.strip() or not reference.certificate.strip():
        text = "name the reference standard and its certificate: without them nothing is traceable"
        found.append(Finding("calibration.no_reference", text, "reference"))
    if not 0 < reference.expanded < float("inf"):
        text = "the certificate states an expanded uncertainty above zero: write it down"
        found.append(Finding("calibration.no_reference", text, "reference.expanded"))
    return found + check_certificates([reference], on=today)


def check_certificates(references: Iterable[Reference], *, on: date) -> list[Finding]:
    """List the standards whose certificate has ended by a day."""
    return [
        Finding(
            "calibration.reference_expired",
            f"the certificate of {one.name} ended on {one.due_on}: renew it first",
            "reference.due_on",
        )
        for one in references
        if one.due_on < on
    ]


def levels_ul(stroke_ul: float) -> tuple[float, ...]:
    """Return the volumes that are weighed: shares of the largest stroke, in tenths of a µL.

    Example:
        >>> levels_ul(5000.0), levels_ul(4849.93)
        ((500.0, 2500.0, 5000.0), (484.9, 2424.9, 4849.9))
    """
    return tuple(int(stroke_ul * share * 10) / 10 for share in LEVELS_RATIO)
