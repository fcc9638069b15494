"""What a device brings into the tree and the physical graph: its parts, places and inner tubes.

Read from the roles that its driver declares and the settings that it was given. Where a setting
does not say how large something is, that stays unknown; nothing is assumed in its place.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.graph.device_parts_by_role import SORTS, WITHOUT_PARTS, RolePlace
from labweb.domain.resources.resource_kinds import KINDS


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceComponent:
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
class InnerTube:
    """A connection between two parts of one device."""

    source: str
    source_port: str
    target: str
    target_port: str


@dataclass(frozen=True, slots=True)
class Injection:
    """All that a device brings; the first part is the one that it is known by."""

    parts: tuple[DeviceComponent, ...] = ()
    tubes: tuple[InnerTube, ...] = ()

    @property
    def nodes(self) -> dict[str, str]:
        """Return the key of the part by role."""
        return {role: part.key for part in self.parts for role in part.roles}


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
    parts: dict[str, DeviceComponent] = {}
    for role, joining in _standing(spec.roles).items():
        sort, first = SORTS[role], not parts
        parts[role] = DeviceComponent(
            key=key if first else f"{key}_{role}",
            name=name if first else f"{name}, {KINDS[sort.kind].label.lower()}",
            kind=sort.kind,
            config=_told({**sort.settings, **_settings(joining)}, known) | dict(sort.fixed),
            roles=(*(sort.roles or (role,)), *joining),
        )
    places = [place for role, part in parts.items() for place in _places(role, part, known)]
    return Injection((*_merged(parts), *places), tuple(_tubes(parts)))


def list_reasons(spec: DriverSpec) -> list[str]:
    """Say of each role of a driver why it brings nothing; empty when one of them does.

    Example:
        >>> list_reasons(DriverSpec(class_name="P", module="m", digest="", roles=("pump",)))
        []
    """
    if any(role in SORTS for role in spec.roles):
        return []
    unknown = "nothing is known to stand in the tree for this role"
    return [f"{role}: {WITHOUT_PARTS.get(role, unknown)}" for role in spec.roles]


def _standing(roles: Sequence[str]) -> dict[str, list[str]]:
    """Return the roles that bring a part, each with those that act through the same part."""
    own = [role for role in roles if role in SORTS]
    hosts = {role: next((one for one in own if one in SORTS[role].joins), role) for role in own}
    return {
        role: [one for one in own if one != role and hosts[one] == role]
        for role in own
        if hosts[role] == role
    }


def _settings(roles: Iterable[str]) -> dict[str, str]:
    return {name: setting for role in roles for name, setting in SORTS[role].settings.items()}


def _told(settings: Mapping[str, str], known: Mapping[str, Any]) -> dict[str, Any]:
    told = {name: known.get(setting) for name, setting in settings.items()}
    return {name: value for name, value in told.items() if value is not None}


def _merged(parts: Mapping[str, DeviceComponent]) -> list[DeviceComponent]:
    """Let a part stand once where two roles are of one kind: a probe of two quantities."""
    found: dict[str, DeviceComponent] = {}
    for part in parts.values():
        same = found.get(part.kind)
        if same is None:
            found[part.kind] = part
            continue
        roles = tuple(dict.fromkeys((*same.roles, *part.roles)))
        found[part.kind] = DeviceComponent(
            key=same.key, name=same.name, kind=same.kind, config=same.config, roles=roles
        )
    return list(found.values())


def _places(
    role: str, part: DeviceComponent, known: Mapping[str, Any]
) -> Iterator[DeviceComponent]:
    """Yield what lies inside a part, a holder before what it holds."""
    for place in SORTS[role].places:
        inside = part.key + place.inside
        for number in _numbers(place, known):
            yield DeviceComponent(
                key=inside + place.key.format(number),
                name=f"{part.name}, {place.label.format(number)}",
                kind=place.kind,
                config=_told(place.settings, known),
                inside=inside,
            )


def _numbers(place: RolePlace, known: Mapping[str, Any]) -> list[str]:
    """Return what the places of one sort are called by their driver; none where it is not told."""
    if not place.each:
        return [""]
    told = known.get(place.each)
    if isinstance(told, int):
        return [str(number) for number in range(1, told + 1)]
    return sorted(told, key=lambda one: (len(one), one)) if isinstance(told, Mapping) else []


def _tubes(parts: Mapping[str, DeviceComponent]) -> list[InnerTube]:
    """Return what is joined inside the device: a syringe stands at its valve's common port."""
    pump, valve = parts.get("pump"), parts.get("valve")
    if pump is None or valve is None:
        return []
    return [
        InnerTube(source=pump.key, source_port="outlet", target=valve.key, target_port="common")
    ]
