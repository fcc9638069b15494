"""What each kind of resource may be configured with: one schema per kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.lab_json_entries import Name, NotNegative, Positive, read_entry
from labweb.domain.resources.labware.definition_check import INSIDE_RATIO, TOLERANCE_MM
from labweb.domain.resources.labware.well_geometry import (
    Cavity,
    Section,
    capacity_ul,
    check_cavity,
    depth_mm,
)
from labweb.domain.resources.resource_kinds import KINDS, is_vessel

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


class RackConfig(LabwareConfig, frozen=True, kw_only=True):
    """Labware in which tubes, vials or other labware stand."""

    sites_count: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    """How many things it takes, one on each site; absent is unknown."""


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
    **dict.fromkeys(("plate", "tip_rack", "reservoir", "lid", "deck"), LabwareConfig),
    **dict.fromkeys(("tube_rack", "carrier"), RackConfig),
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


def _check_inside(config: Mapping[str, Any], sections: Cavity) -> list[str]:
    """Compare what is stated of a cavity with its shape, where that is one."""
    if check_cavity(sections):
        return []
    problems = []
    stated, holds = config.get("capacity_ul"), capacity_ul(sections)
    if stated is not None and stated > holds * (1 + INSIDE_RATIO):
        problems.append(f"holds {holds:.4g} µL, and capacity_ul is {stated:g}")
    depth = config.get("depth_mm")
    if depth is not None and depth_mm(sections) > depth + TOLERANCE_MM:
        problems.append(f"is {depth_mm(sections):g} mm deep, and depth_mm is {depth:g}")
    return problems


def _check_ranges(config: Mapping[str, Any], subject: str) -> list[Finding]:
    limits = [
        (name, f"max_{name.removeprefix('min_')}") for name in config if name.startswith("min_")
    ]
    findings = []
    for low_name, high_name, may_meet in (
        *((low, high, True) for low, high in limits),
        ("dead_volume_ul", "capacity_ul", False),
        ("overlap_mm", "length_mm", False),
        ("tip_overlap_mm", "tip_length_mm", False),
        ("resolution_mg", "max_load_mg", False),
    ):
        low, high = config.get(low_name), config.get(high_name)
        if low is None or high is None or low < high or (may_meet and low == high):
            continue
        relation = "above" if low > high else "not below"
        message = f"{subject}.config: {low_name} {low} is {relation} {high_name} {high}"
        findings.append(Finding("lab_file.range", message, subject, {"field": low_name}))
    if config.get("cavity") is not None:
        sections = msgspec.convert(config["cavity"], Cavity)
        findings += [
            Finding("lab_file.range", f"{subject}.config: cavity: {problem}", subject)
            for problem in (*check_cavity(sections), *_check_inside(config, sections))
        ]
    return findings
