"""What a device brings into the tree and the physical graph: its parts, places and inner tubes.

Read from the roles that its driver declares and the settings that it was given. Where a setting
does not say how large something is, that stays unknown; nothing is assumed in its place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from labweb.domain.enrollment.spec import DriverSpec
from labweb.domain.errors import Finding
from labweb.domain.resources.kinds import KINDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One resource that comes with a device."""

    key: str
    name: str
    kind: str
    config: Mapping[str, Any] = field(default_factory=dict)
    roles: tuple[str, ...] = ()
    """What the driver does there; none for a place inside another part."""

    inside: str = ""
    """Key of the part in which it lies; empty: beside the others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tube:
    """A connection between two parts of one device."""

    source: str
    source_port: str
    target: str
    target_port: str


@dataclass(frozen=True, slots=True)
class Injection:
    """All that a device brings; the first part is the one that it is known by."""

    parts: tuple[Part, ...] = ()
    tubes: tuple[Tube, ...] = ()

    @property
    def nodes(self) -> dict[str, str]:
        """Return the key of the part by role."""
        return {role: part.key for part in self.parts for role in part.roles}


@dataclass(frozen=True, slots=True)
class _Sort:
    kind: str
    settings: Mapping[str, str] = field(default_factory=dict)
    """Field of the resource → setting of the driver, of the same unit."""

    fixed: Mapping[str, Any] = field(default_factory=dict)
    roles: tuple[str, ...] = ()
    """As what it stands in the tree; empty: as the role itself."""


_HEATS = {"max_temperature_c": "max_temperature_c", "min_temperature_c": "min_temperature_c"}
_STIRS = {"max_speed_rpm": "max_speed_rpm", "min_speed_rpm": "min_speed_rpm"}

_SORTS: Mapping[str, _Sort] = {
    "pump": _Sort("syringe_pump", {"capacity_ul": "syringe_ul"}),
    "valve": _Sort("rotary_valve", {"ports_count": "ports_count"}, {"common_port": "common"}),
    "heater_stirrer": _Sort("heater_stirrer", {**_HEATS, **_STIRS}, {}, ("heater", "stirrer")),
    "stirrer": _Sort("stirrer", _STIRS),
    "thermostat": _Sort("thermostat", _HEATS),
    "rotary_evaporator": _Sort("rotary_evaporator", {**_HEATS, **_STIRS}),
    "vacuum_controller": _Sort("vacuum_controller"),
    "balance": _Sort("balance"),
    "timer": _Sort("timer"),
    "ph_sensor": _Sort("transmitter", {}, {}, ("transmitter",)),
    "tds_sensor": _Sort("transmitter", {}, {}, ("transmitter",)),
    "conductivity_sensor": _Sort("transmitter", {}, {}, ("conductivity_sensor",)),
    "storage": _Sort("storage"),
}
"""What stands in the tree for each role. Roles that are not here act through nothing there."""


def injected(spec: DriverSpec, config: Mapping[str, Any], *, key: str, name: str) -> Injection:
    """Return what a device with this driver and these settings brings; nothing may be it.

    Args:
        spec: What its driver declares.
        config: Its settings; what is not in it is as by default.
        key: Of the device: its first part has the same one.
        name: Of the device.

    Example:
        >>> pump = DriverSpec(class_name="P", module="m", digest="", roles=("pump", "valve"))
        >>> made = injected(pump, {"syringe_ul": 500.0}, key="p", name="P")
        >>> [(part.key, part.kind) for part in made.parts], made.nodes
        ([('p', 'syringe_pump'), ('p_valve', 'rotary_valve')], {'pump': 'p', 'valve': 'p_valve'})
    """
    known = {one.name: one.default for one in spec.config if not one.required} | dict(config)
    parts: dict[str, Part] = {}
    for role in spec.roles:
        sort = _SORTS.get(role)
        if sort is None:
            continue
        own = key if not parts else f"{key}_{role}"
        parts[role] = Part(
            key=own,
            name=name if not parts else f"{name}, {KINDS[sort.kind].label.lower()}",
            kind=sort.kind,
            config=_config(sort, known),
            roles=sort.roles or (role,),
        )
    places = [place for role, part in parts.items() for place in _places(role, part, known)]
    return Injection((*_merged(parts), *places), tuple(_tubes(parts)))


def check_parts(old: DriverSpec, new: DriverSpec, config: Mapping[str, Any]) -> list[Finding]:
    """List every part and inner tube that another version of a driver adds, takes away or changes.

    The tree and the graph have the parts of the version that the device was taken up with. One
    with others would act on what nobody recorded, or leave behind what nobody drives.

    Args:
        old: What serves the device now.
        new: What shall.
        config: Settings of the device.

    Example:
        >>> pump = DriverSpec(class_name="P", module="m", digest="", roles=("pump",))
        >>> both = DriverSpec(class_name="P", module="m", digest="", roles=("pump", "valve"))
        >>> [one.code for one in check_parts(pump, both, {})], check_parts(pump, pump, {})
        (['driver.parts_gained', 'driver.parts_gained'], [])
    """
    before, after = (
        {one.key: one for one in made.parts}
        | {f"{one.source}.{one.source_port}": one for one in made.tubes}
        for made in (injected(spec, config, key="device", name="device") for spec in (old, new))
    )
    gained, lost = sorted(after.keys() - before.keys()), sorted(before.keys() - after.keys())
    changed = sorted(key for key in before if key in after and before[key] != after[key])
    told = partial(_told, new.class_name)
    return [
        *(Finding("driver.parts_gained", told("brings", after[key]), key) for key in gained),
        *(Finding("driver.parts_lost", told("has no more", before[key]), key) for key in lost),
        *(Finding("driver.parts_changed", told("changes", after[key]), key) for key in changed),
    ]


def _told(version: str, verb: str, what: Part | Tube) -> str:
    return (
        f"{version} {verb} {_called(what)}, and the parts of a device stay as they were taken up: "
        "retire it, and take it up anew with this version"
    )


def _called(what: Part | Tube) -> str:
    """Return what a person calls a part or a tube, with the settings that make it what it is."""
    if isinstance(what, Tube):
        return f"a tube from {what.source_port} to {what.target_port}"
    settings = ", ".join(f"{name} {value}" for name, value in sorted(what.config.items()))
    told = KINDS[what.kind].label.lower() + (f" {what.name}" if what.inside else "")
    return f"a {told} ({settings})" if settings else f"a {told}"


def _config(sort: _Sort, known: Mapping[str, Any]) -> dict[str, Any]:
    told = {name: known.get(setting) for name, setting in sort.settings.items()}
    return {**{name: value for name, value in told.items() if value is not None}, **sort.fixed}


def _merged(parts: Mapping[str, Part]) -> list[Part]:
    """Let a part stand once where two roles are of one kind: a probe of two quantities."""
    found: dict[str, Part] = {}
    for part in parts.values():
        same = found.get(part.kind)
        if same is None:
            found[part.kind] = part
            continue
        roles = tuple(dict.fromkeys((*same.roles, *part.roles)))
        found[part.kind] = Part(
            key=same.key, name=same.name, kind=same.kind, config=same.config, roles=roles
        )
    return list(found.values())


def _places(role: str, part: Part, known: Mapping[str, Any]) -> list[Part]:
    """Return the places inside a part, by the number that the driver gives them."""
    if role != "storage" or not isinstance(known.get("slots_count"), int):
        return []
    names = {f"slot_{n}": f"place {n}" for n in range(1, known["slots_count"] + 1)}
    names["transfer"] = "transfer station"
    return [
        Part(key=f"{part.key}_{end}", name=f"{part.name}, {label}", kind="slot", inside=part.key)
        for end, label in names.items()
    ]


def _tubes(parts: Mapping[str, Part]) -> list[Tube]:
    """Return what is joined inside the device: a syringe stands at its valve's common port."""
    pump, valve = parts.get("pump"), parts.get("valve")
    if pump is None or valve is None:
        return []
    return [Tube(source=pump.key, source_port="outlet", target=valve.key, target_port="common")]
