"""What each kind of resource may be configured with: one schema per kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.entries import Name, NotNegative, Positive, read_entry
from labweb.domain.resources.kinds import KINDS, is_vessel
from labweb.domain.resources.labware.geometry import Cavity, Section, check_cavity

Celsius = Annotated[float, Meta(ge=-273.15, le=3000)]
Stream = Literal[
    "aqueous",
    "acid",
    "base",
    "organic",
    "halogenated",
    "oxidizer",
    "water_reactive",
    "cyanide",
    "sulfide",
    "azide",
    "metal",
]
"""A stream of waste, as `resources.compatibility_table` sorts groups of substances into them."""


class _Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all schemas."""


class PlainConfig(_Config, frozen=True, kw_only=True):
    """Kinds with nothing to set."""


class VesselConfig(_Config, frozen=True, kw_only=True):
    """Everything that holds liquid."""

    capacity_ul: Positive | None = None
    """Absent is unknown: such a vessel can be emptied, never filled by plan."""

    capacity_mg: Positive | None = None
    """The same for solids and gases, which are counted by mass."""

    dead_volume_ul: NotNegative | None = None
    """What cannot be drawn out."""

    tare_mg: NotNegative | None = None
    temperature_c: Celsius | None = None
    gas: Name | None = None
    """Gas that it gives by its connections for gas, as recipes call it. It holds no liquid."""


class CavityConfig(VesselConfig, frozen=True, kw_only=True):
    """A vessel of labware, with the shape of its inside where a definition tells it."""

    depth_mm: Positive | None = None
    is_round: bool | None = None
    cavity: tuple[Section, ...] | None = None
    """Sections from the bottom up; absent is unknown."""


class WasteConfig(VesselConfig, frozen=True, kw_only=True):
    """A vessel for waste."""

    takes: tuple[Stream, ...] | None = None
    """Streams that it takes; absent: whatever a lab without divided wastes pours away."""


class TipConfig(VesselConfig, frozen=True, kw_only=True):
    """A tip of a pipette."""

    length_mm: Positive | None = None
    overlap_mm: NotNegative | None = None


class TipSpotConfig(_Config, frozen=True, kw_only=True):
    """A place for a tip, and the tips that it is made for."""

    tip_length_mm: NotNegative | None = None
    tip_overlap_mm: NotNegative | None = None
    tip_capacity_ul: NotNegative | None = None


class LabwareConfig(_Config, frozen=True, kw_only=True):
    """A piece of labware that a definition describes."""

    definition: Name | None = None
    definition_format: Name | None = None


class RotaryValveConfig(_Config, frozen=True, kw_only=True):
    """A selector: one common port, joined to one of the numbered ports at a time."""

    ports_count: Annotated[int, Meta(ge=2, le=64)] | None = None
    common_port: Annotated[str, Meta(min_length=1, max_length=500)] | None = None
    """Name of the port that is joined to each of the others in turn."""


class CartridgeConfig(_Config, frozen=True, kw_only=True):
    """A cartridge or a column."""

    filling: Name | None = None
    """What liquid runs through in it, as recipes call it."""


class HeaterConfig(_Config, frozen=True, kw_only=True):
    """Range that may be asked for."""

    min_temperature_c: Celsius | None = None
    max_temperature_c: Celsius | None = None


class StirrerConfig(_Config, frozen=True, kw_only=True):
    """Range that may be asked for."""

    min_speed_rpm: NotNegative | None = None
    max_speed_rpm: Positive | None = None


class HeaterStirrerConfig(_Config, frozen=True, kw_only=True):
    """Ranges that may be asked for."""

    min_temperature_c: Celsius | None = None
    max_temperature_c: Celsius | None = None
    min_speed_rpm: NotNegative | None = None
    max_speed_rpm: Positive | None = None


class BalanceConfig(_Config, frozen=True, kw_only=True):
    """Range and fineness of the display."""

    max_load_mg: Positive | None = None
    resolution_mg: Positive | None = None


_SPECIAL: Mapping[str, type[_Config]] = {
    **dict.fromkeys(("well", "tube", "trough"), CavityConfig),
    **dict.fromkeys(("plate", "tip_rack", "tube_rack", "reservoir", "carrier"), LabwareConfig),
    **dict.fromkeys(("lid", "deck"), LabwareConfig),
    "waste": WasteConfig,
    "tip": TipConfig,
    "tip_spot": TipSpotConfig,
    "rotary_valve": RotaryValveConfig,
    "cartridge": CartridgeConfig,
    **dict.fromkeys(("heater", "thermostat", "furnace", "plate_reader"), HeaterConfig),
    **dict.fromkeys(("rotary_evaporator", "shaker"), HeaterStirrerConfig),
    **dict.fromkeys(("stirrer", "phase_separator"), StirrerConfig),
    "heater_stirrer": HeaterStirrerConfig,
    "balance": BalanceConfig,
}


def config_schema(kind: str) -> type[msgspec.Struct] | None:
    """Return the schema of a kind's config; None for `foreign`, which takes anything."""
    if kind == "foreign":
        return None
    return _SPECIAL.get(kind) or (VesselConfig if is_vessel(kind) else PlainConfig)


def check_config(kind: str, config: Mapping[str, Any], subject: str) -> list[Finding]:
    """List every field of a resource's config that its kind does not allow."""
    if kind not in KINDS:
        message = f"{subject}: kind: {kind!r} is not one of {', '.join(KINDS)}"
        return [Finding("lab_file.unknown_kind", message, subject, {"field": "kind"})]
    schema = config_schema(kind)
    if schema is None:
        return []
    findings: list[Finding] = []
    read_entry(config, schema, f"{subject}.config", findings)
    return findings or _check_ranges(config, subject)


def _check_ranges(config: Mapping[str, Any], subject: str) -> list[Finding]:
    pairs = (
        ("min_temperature_c", "max_temperature_c"),
        ("min_speed_rpm", "max_speed_rpm"),
        ("dead_volume_ul", "capacity_ul"),
    )
    findings = []
    for low_name, high_name in pairs:
        low, high = config.get(low_name), config.get(high_name)
        if low is not None and high is not None and low > high:
            message = f"{subject}.config: {low_name} {low} is above {high_name} {high}"
            findings.append(Finding("lab_file.range", message, subject, {"field": low_name}))
    if config.get("cavity") is not None:
        sections = msgspec.convert(config["cavity"], Cavity)
        findings += [
            Finding("lab_file.range", f"{subject}.config: cavity: {problem}", subject)
            for problem in check_cavity(sections)
        ]
    return findings
