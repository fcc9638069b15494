"""What another version of a driver changes of the parts that its device has in the tree.

Parts are matched by what the driver does in them, never by name: a valve is the same valve when it
stands second instead of first. One that becomes another kind of thing goes, and another comes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import msgspec

from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import Finding
from labweb.domain.graph.device_parts import DeviceComponent, Injection, InnerTube, injected
from labweb.domain.resources.resource_kinds import KINDS


@dataclass(frozen=True, slots=True, kw_only=True)
class PartChanges:
    """What comes, goes and becomes otherwise; keys are those of `injected`."""

    before: Injection
    after: Injection
    kept: Mapping[str, str] = field(default_factory=dict)
    """Key after → key before, of each part that stays."""

    gained: tuple[DeviceComponent, ...] = ()
    lost: tuple[DeviceComponent, ...] = ()
    changed: tuple[tuple[DeviceComponent, DeviceComponent], ...] = ()
    """Before and after, of the same kind: other settings, or other roles."""

    joined: tuple[InnerTube, ...] = ()
    """With the keys after."""

    parted: tuple[InnerTube, ...] = ()
    """With the keys before."""

    def __bool__(self) -> bool:
        """Say whether anything changes."""
        return any((self.gained, self.lost, self.changed, self.joined, self.parted))


def find_changes(
    old: DriverSpec, new: DriverSpec, config: Mapping[str, Any], *, key: str, name: str
) -> PartChanges:
    """Return what another version of a driver makes of the parts of a device.

    Args:
        old: What serves the device now.
        new: What shall.
        config: Settings of the device.
        key: Of the device.
        name: Of the device.

    Example:
        >>> pump = DriverSpec(class_name="P", module="m", digest="", roles=("pump",))
        >>> both = DriverSpec(class_name="P", module="m", digest="", roles=("pump", "valve"))
        >>> found = find_changes(pump, both, {}, key="p", name="P")
        >>> [part.key for part in found.gained], len(found.joined), bool(found.lost)
        (['p_valve'], 1, False)
    """
    before, after = (injected(spec, config, key=key, name=name) for spec in (old, new))
    same = _matched(before, after)
    kept = {to.key: was.key for was, to in same}
    stay = set(kept.values())
    tubes = {_ends(tube, {}) for tube in before.tubes}
    joins = {_ends(tube, kept) for tube in after.tubes}
    return PartChanges(
        before=before,
        after=after,
        kept=kept,
        gained=tuple(part for part in after.parts if part.key not in kept),
        lost=tuple(part for part in before.parts if part.key not in stay),
        changed=tuple((was, to) for was, to in same if _is_other(was, to)),
        joined=tuple(tube for tube in after.tubes if _ends(tube, kept) not in tubes),
        parted=tuple(tube for tube in before.tubes if _ends(tube, {}) not in joins),
    )


def _matched(before: Injection, after: Injection) -> list[tuple[DeviceComponent, DeviceComponent]]:
    """Return the parts that are the same ones: of one role and kind, or one place in the same."""
    by_role = {role: part for part in before.parts for role in part.roles}
    found: list[tuple[DeviceComponent, DeviceComponent]] = []
    for to in after.parts:
        shared = [by_role[role] for role in to.roles if role in by_role]
        taken = {was.key for was, _ in found}
        found += [(was, to) for was in shared if was.kind == to.kind and was.key not in taken][:1]
    holders = {to.key: was.key for was, to in found}
    places = {(part.inside, part.key.removeprefix(part.inside)): part for part in before.parts}
    for to in after.parts:
        if to.inside in holders:
            was = places.get((holders[to.inside], to.key.removeprefix(to.inside)))
            if was is not None:
                found.append((was, to))
                holders[to.key] = was.key
    return found


def _ends(tube: InnerTube, names: Mapping[str, str]) -> tuple[str, str, str, str]:
    source, target = (names.get(end, f"new {end}") for end in (tube.source, tube.target))
    if not names:
        source, target = tube.source, tube.target
    return (source, tube.source_port, target, tube.target_port)


def _is_other(was: DeviceComponent, to: DeviceComponent) -> bool:
    return dict(was.config) != dict(to.config) or set(was.roles) != set(to.roles)


def list_changes(changes: PartChanges, version: str) -> list[Finding]:
    """Tell every part and inner tube that comes, goes or changes, for a person to decide on.

    Args:
        changes: As `find_changes` gives them.
        version: Class of the driver.
    """
    told = partial(_told, version)
    return [
        *(Finding("driver.parts_gained", told("brings", one), one.key) for one in changes.gained),
        *(
            Finding("driver.parts_gained", told("brings", tube), _name(tube))
            for tube in changes.joined
        ),
        *(Finding("driver.parts_lost", told("has no more", one), one.key) for one in changes.lost),
        *(
            Finding("driver.parts_lost", told("has no more", tube), _name(tube))
            for tube in changes.parted
        ),
        *(
            Finding("driver.parts_changed", _turned(version, was, to), was.key)
            for was, to in changes.changed
        ),
    ]


def decision_of(changes: PartChanges, version: str) -> str:
    """Return the digest of what a person decides on; empty when no part changes.

    Who agreed to one list has not agreed to another.
    """
    if not changes:
        return ""
    told = sorted((one.code, one.subject, one.message) for one in list_changes(changes, version))
    return hashlib.sha256(msgspec.json.encode(told)).hexdigest()


def _name(tube: InnerTube) -> str:
    return f"{tube.source}.{tube.source_port}"


def _told(version: str, verb: str, what: DeviceComponent | InnerTube) -> str:
    return f"{version} {verb} {_called(what)}"


def _turned(version: str, was: DeviceComponent, to: DeviceComponent) -> str:
    roles = "" if set(was.roles) == set(to.roles) else f", as {', '.join(to.roles)}"
    return f"{version} has {_called(to)}{roles} where it had {_called(was)}"


def _called(what: DeviceComponent | InnerTube) -> str:
    """Return what a person calls a part or a tube, with the settings that make it what it is."""
    if isinstance(what, InnerTube):
        return f"a tube from {what.source_port} to {what.target_port}"
    settings = ", ".join(f"{name} {value}" for name, value in sorted(what.config.items()))
    told = KINDS[what.kind].label.lower() + (f" {what.name}" if what.inside else "")
    return f"a {told} ({settings})" if settings else f"a {told}"
