"""What a device says about itself, however it was asked: a spec, and what is behind its names."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import msgspec

from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec, StatusSpec
from labweb.domain.errors import Finding


class NodeBinding(msgspec.Struct, frozen=True, kw_only=True):
    """What is behind a name of the spec."""

    node: str
    """Of OPC UA `nsu=…;…`, which holds in every session; of SiLA the feature and its part; of
    OpenAPI method, path and the way in its JSON."""

    owner: str = ""
    """Of a method of OPC UA: the object that it is called on."""

    factor: float = 1.0
    """Our number is the server's times this, …"""

    offset: float = 0.0
    """… and this added."""


class Browsed(msgspec.Struct, frozen=True, kw_only=True):
    """What a server says about one device."""

    spec: DriverSpec
    bindings: dict[str, NodeBinding]


@dataclass
class Collected:
    """Statuses, actions and findings, while they are collected."""

    statuses: list[StatusSpec] = field(default_factory=list)
    actions: list[ActionSpec] = field(default_factory=list)
    bindings: dict[str, NodeBinding] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)

    def add(self, told: StatusSpec | ActionSpec, binding: NodeBinding) -> None:
        """Keep one, unless its name is taken or is none."""
        if not told.name.isidentifier() or told.name in self.bindings:
            self.refuse("name", f"the name {told.name!r} is taken or is none", binding.node)
            return
        self.bindings[told.name] = binding
        if isinstance(told, StatusSpec):
            self.statuses.append(told)
        else:
            self.actions.append(told)

    def refuse(self, code: str, message: str, subject: str) -> None:
        """Leave something out, and say why."""
        self.findings.append(Finding(f"browse.{code}", message, subject))

    def browsed(self, *, name: str, transport: str, doc: str, protocol: str) -> Browsed:
        """Return all of it, with a digest that changes when the device does."""
        spec = DriverSpec(
            class_name="".join(word.capitalize() for word in snake((name,)).split("_")),
            module="",
            digest="",
            transport=transport,
            doc=doc,
            protocol=protocol,
            actions=tuple(self.actions),
            statuses=tuple(self.statuses),
            findings=tuple(self.findings),
        )
        return sealed(spec, self.bindings)


def sealed(spec: DriverSpec, bindings: Mapping[str, NodeBinding]) -> Browsed:
    """Give a spec the digest of itself and of what is behind its names."""
    whole = msgspec.json.encode([spec, dict(bindings)], order="sorted")
    digest = hashlib.sha256(whole).hexdigest()
    return Browsed(spec=msgspec.structs.replace(spec, digest=digest), bindings=dict(bindings))


def snake(way: tuple[str, ...], *, without: Collection[str] = ()) -> str:
    """Make a name of a way.

    Example:
        >>> snake(("solventSystem", "flowIsEnabled"))
        'solvent_system_flow_is_enabled'
    """
    words = [
        re.sub(r"(?<=[a-z0-9])(?=[A-Z])|[^A-Za-z0-9]+", "_", part)
        for part in way
        if part not in without
    ]
    return "_".join(words).strip("_").lower()
