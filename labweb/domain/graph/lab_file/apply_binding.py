"""Apply a binding: foreign classes become kinds, and nodes become devices."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count, islice
from typing import Any
from uuid import UUID

from labweb.domain.errors import Finding, LabFileError
from labweb.domain.graph.lab_file.binding_file import (
    BindingFile,
    ClassRule,
    DeviceRule,
    JoinRule,
    SelectorRule,
    ValueRule,
    find_value,
    is_match,
)
from labweb.domain.graph.lab_file.lab_check import PLACE_CODES, check_lab, place_notes
from labweb.domain.graph.lab_file.lab_model import (
    DeviceEntry,
    HostEntry,
    LabFile,
    LabFileSimulator,
    entry_id,
)
from labweb.domain.graph.lab_file.link_media import largest_port, name_media, tubes_of
from labweb.domain.graph.lab_file.resource_config import check_config
from labweb.domain.graph.lab_file.uni_lab_os.format_words import FORMAT
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import NodeStock
from labweb.domain.graph.lab_file.uni_lab_os.node_as_resource import (
    NodePlace,
    is_imported,
    to_node,
    to_resource,
)
from labweb.domain.graph.lab_file.untrusted_json import refuse_all
from labweb.domain.graph.ports_and_connections import Medium, PortRef
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS, Nature, is_vessel

UNBOUND = "binding.unbound"
"""Code of the note on a node that some rule is for, but that became no device."""

UNMAPPED = "binding.unmapped"
"""Code of the note on a class that nobody mapped."""


def apply_binding(
    lab: LabFile, binding: BindingFile, nodes: Mapping[UUID, Mapping[str, Any]] | None = None
) -> tuple[LabFile, tuple[Finding, ...]]:
    """Give an imported lab its kinds and devices.

    A device is made only when everything that its rule names is there. Export still
    gives back the file that was imported.

    Args:
        lab: Imported, without devices.
        binding: What classes are, and which nodes make a device.
        nodes: Resource → node of the graph as its file has it; None: a lab of Uni-Lab-OS, whose
            resources carry theirs.

    Returns:
        The lab, in mode sim, and notes on every node that stayed foreign or unbound.

    Raises:
        LabFileError: The result would be no lab; its findings say why.
    """
    notes: list[Finding] = []
    kinded = _apply_classes(lab, binding, notes)
    kinded = replace(kinded, connections=name_media(kinded, binding.tubes))
    raw = {r.id: to_node(r) for r in kinded.resources if is_imported(r)} if nodes is None else nodes
    bound = _Binder(kinded, binding, raw, notes).bind()
    findings = check_lab(bound)
    if findings:
        raise refuse_all(findings, f"the binding of {lab.name!r}")
    notes += place_notes(bound)
    before = [note for note in lab.notes if note.code not in PLACE_CODES]
    return replace(bound, notes=(*before, *notes)), tuple(notes)


def _apply_classes(lab: LabFile, binding: BindingFile, notes: list[Finding]) -> LabFile:
    stock = NodeStock(
        lab.id,
        {material.key: material for material in lab.materials},
        list(lab.lots),
        {resource_id: dict(contents) for resource_id, contents in lab.contents.items()},
    )
    resources = []
    for resource in lab.resources:
        node = to_node(resource) if is_imported(resource) else None
        rule = None if node is None else binding.class_rule(node.get("class"))
        if node is not None and rule is None and resource.kind == "foreign":
            why = binding.why_unbound(node.get("class")) or "it is mapped to no kind"
            text = f"{resource.key}: class {node.get('class')!r}: {why}"
            notes.append(Finding(UNMAPPED, text, resource.key))
        if node is None or rule is None:
            resources.append(resource)
            continue
        resources.append(_rekind(resource, node, rule, stock, notes))
    return replace(
        lab,
        resources=tuple(resources),
        materials=tuple(stock.materials.values()),
        lots=tuple(stock.lots),
        contents=stock.contents,
        notes=lab.notes,
    )


def _rekind(
    resource: Resource,
    node: dict[str, Any],
    rule: ClassRule,
    stock: NodeStock,
    notes: list[Finding],
) -> Resource:
    config: dict[str, Any] = {}
    for name, value_rule in rule.config.items():
        try:
            value = find_value(value_rule, node)
        except LabFileError as error:
            notes.append(Finding(error.code, f"{resource.key}: {error.message}", resource.key))
            continue
        wrong = [] if value is None else check_config(rule.kind, {name: value}, resource.key)
        notes += [Finding("binding.value", finding.message, resource.key) for finding in wrong]
        if value is not None and not wrong:
            config[name] = value
    wrong = check_config(rule.kind, config, resource.key)
    if wrong:
        notes += [Finding("binding.value", finding.message, resource.key) for finding in wrong]
        config = {}
    place = NodePlace(
        resource.id, resource.key, resource.parent_id, resource.extra[FORMAT]["parent"]
    )
    rebuilt, holding = to_resource(place, node, rule.kind, config)
    if is_vessel(resource.kind) != is_vessel(rule.kind):
        _forget(stock, resource.id)
        stock.add(rebuilt, holding)
        notes += holding.notes
    return rebuilt


def _timers(
    lab: LabFile, binding: BindingFile, host: HostEntry
) -> list[tuple[Resource, DeviceEntry]]:
    """Give the host its timers, under the root; an export of the graph leaves them out."""
    taken = {*lab.tree.by_key, *(device.key for device in lab.devices)}
    free = (key for number in count(1) if (key := f"timer_{number}") not in taken)
    root = next(resource for resource in lab.resources if resource.parent_id is None)
    return [_timer(lab, root.id, host, key) for key in islice(free, binding.host.timers_count)]


def _timer(lab: LabFile, root_id: UUID, host: HostEntry, key: str) -> tuple[Resource, DeviceEntry]:
    name = f"{key.replace('_', ' ').capitalize()} of the host"
    resource = Resource(
        id=entry_id(lab.id, "resource", key),
        key=key,
        name=name,
        kind="timer",
        nature=KINDS["timer"].nature,
        parent_id=root_id,
        extra={FORMAT: {"synthetic": True}} if FORMAT in lab.extra else {},
    )
    device = DeviceEntry(
        id=entry_id(lab.id, "device", key),
        key=key,
        name=name,
        host_id=host.id,
        driver="drivers.virtual.timer:HostTimer",
        nodes={"timer": resource.id},
        simulator=LabFileSimulator(model="timer"),
    )
    return resource, device


def _forget(stock: NodeStock, resource_id: UUID) -> None:
    gone: Mapping[LotId, int] = stock.contents.pop(resource_id, {})
    stock.lots = [lot for lot in stock.lots if LotId(str(lot.id)) not in gone]


@dataclass(frozen=True)
class _Candidate:
    """Nodes that a device rule might join, by role."""

    nodes: Mapping[str, Resource]


class _Binder:
    """One run over the device rules of a binding."""

    def __init__(
        self,
        lab: LabFile,
        binding: BindingFile,
        raw: Mapping[UUID, Mapping[str, Any]],
        notes: list[Finding],
    ) -> None:
        self.lab = lab
        self.binding = binding
        self.notes = notes
        self.raw = raw
        self.taken = {node for device in lab.devices for node in device.nodes.values()}
        self.tried: set[UUID] = set(self.taken)
        """Nodes that a rule was for, whether they became a device or not: no other is tried."""

        self.reasons: dict[UUID, list[str]] = {}

    def bind(self) -> LabFile:
        """Make every device that can be made; note every node that is left over."""
        host = HostEntry(
            id=entry_id(self.lab.id, "host", self.binding.host.key),
            key=self.binding.host.key,
            name=self.binding.host.name,
        )
        devices = list(self.lab.devices)
        for rule in self.binding.devices:
            for candidate in self._candidates(rule):
                device = self._device(rule, candidate, host)
                self.tried.update(resource.id for resource in candidate.nodes.values())
                if device is not None:
                    devices.append(device)
                    self.taken.update(device.nodes.values())
        self._note_left_over()
        hosts = self.lab.hosts
        if devices and host.key not in {known.key for known in hosts}:
            hosts = (*hosts, host)
        timers = _timers(self.lab, self.binding, host) if devices else []
        return replace(
            self.lab,
            resources=(*self.lab.resources, *(resource for resource, _ in timers)),
            devices=(*devices, *(device for _, device in timers)),
            hosts=hosts,
        )

    def _note_left_over(self) -> None:
        for resource_id, node in self.raw.items():
            resource = self.lab.tree.by_id[resource_id]
            why = self.binding.why_unbound(node.get("class"))
            if why is not None and KINDS[resource.kind].nature is Nature.ACTION:
                self._blame([resource], why)
        for resource_id, reasons in self.reasons.items():
            if resource_id not in self.taken:
                resource = self.lab.tree.by_id[resource_id]
                text = f"{resource.key}: no device was made of it: {'; '.join(reasons)}"
                self.notes.append(Finding(UNBOUND, text, resource.key))

    def _blame(self, resources: Iterable[Resource], reason: str) -> None:
        for resource in resources:
            self.reasons.setdefault(resource.id, []).append(reason)

    def _of_classes(self, patterns: list[str]) -> list[Resource]:
        return [
            self.lab.tree.by_id[resource_id]
            for resource_id, node in self.raw.items()
            if resource_id not in self.tried
            and any(is_match(node.get("class"), pattern) for pattern in patterns)
        ]

    def _candidates(self, rule: DeviceRule) -> Iterator[_Candidate]:
        roles = list(rule.roles)
        firsts = self._of_classes(rule.roles[roles[0]])
        if rule.join is None or rule.join.by == "node":
            yield from (_Candidate(dict.fromkeys(roles, first)) for first in firsts)
            return
        seconds = self._of_classes(rule.roles[roles[1]])
        first_ids = {first.id for first in firsts}
        second_ids = {second.id for second in seconds}
        self._blame(seconds, f"{rule.name}: no {roles[0]} is joined to it")
        for first in firsts:
            partners = self._partners(rule.join, roles, first) & second_ids
            if len(partners) != 1:
                what = "no" if not partners else f"{len(partners)} nodes as"
                self._blame([first], f"{rule.name}: {what} {roles[1]} joined to it")
                continue
            second = self.lab.tree.by_id[partners.pop()]
            if len(self._partners(rule.join, roles[::-1], second) & first_ids) != 1:
                self._blame([first, second], f"{rule.name}: several nodes as {roles[0]} share it")
                continue
            yield _Candidate({roles[0]: first, roles[1]: second})

    def _partners(self, join: JoinRule, roles: list[str], resource: Resource) -> set[UUID]:
        """Return what is joined, as the second of the roles, to a node in the first."""
        if join.by == "vessel":
            vessels = self._vessels(resource, join.media)
            if len(vessels) != 1:
                return set()
            vessel = self.lab.tree.by_id[next(iter(vessels))]
            around = {far.resource_id for _, far in self._links(vessel, join.media)}
            by_id = self.lab.tree.by_id
            return {near for near in around if self._vessels(by_id[near], join.media) == vessels}
        own_port, far_port = (join.ports.get(role) for role in roles)
        return {
            far.resource_id
            for own, far in self._links(resource, join.media)
            if own_port in (None, own.port) and far_port in (None, far.port)
        }

    def _links(self, resource: Resource, media: list[Medium]) -> Iterator[tuple[PortRef, PortRef]]:
        for connection in self.lab.graph.by_resource.get(resource.id, ()):
            if connection.medium in media:
                ends = (connection.source, connection.target)
                yield ends if ends[0].resource_id == resource.id else ends[::-1]

    def _vessels(self, resource: Resource, media: list[Medium]) -> set[UUID]:
        return {
            far.resource_id
            for _, far in self._links(resource, media)
            if is_vessel(self.lab.tree.by_id[far.resource_id].kind)
        }

    def _device(
        self, rule: DeviceRule, candidate: _Candidate, host: HostEntry
    ) -> DeviceEntry | None:
        nodes = candidate.nodes
        try:
            config = self._values(rule.config, nodes)
            settings = self._values(rule.simulator.settings, nodes)
            if rule.selector is not None:
                self._check_selector(rule.selector, nodes)
        except LabFileError as error:
            self._blame(nodes.values(), f"{rule.name}: {error.message}")
            return None
        first = next(iter(nodes.values()))
        return DeviceEntry(
            id=entry_id(self.lab.id, "device", first.key),
            key=first.key,
            name=first.name,
            host_id=host.id,
            driver=rule.driver,
            config=config,
            nodes={role: resource.id for role, resource in nodes.items()},
            simulator=LabFileSimulator(model=rule.simulator.model, settings=settings),
        )

    def _value(self, rule: ValueRule, nodes: Mapping[str, Resource]) -> Any:  # noqa: ANN401 - JSON
        resource = nodes[rule.role] if rule.role else next(iter(nodes.values()))
        if rule.tubes:
            value, wanted = largest_port(self.lab, resource), "tube at a numbered port"
        else:
            value, wanted = find_value(rule, self.raw[resource.id]), rule.named
        if value is None:
            raise LabFileError(f"{resource.key} has no {wanted}", code="binding.value")
        return value if rule.form != "number" else self._within(rule, value, resource)

    def _within(self, rule: ValueRule, value: float, resource: Resource) -> float:
        """Cut a value to what the instrument can do, and note it."""
        found = rule.within(value)
        text = f"{rule.named} is {value:g}, and the instrument ends at {found:g}: that is taken"
        note = Finding("binding.value", text, resource.key)
        if found != value and note not in self.notes:
            self.notes.append(note)
        return found

    def _values(
        self, values: Mapping[str, ValueRule], nodes: Mapping[str, Resource]
    ) -> dict[str, Any]:
        return {name: self._value(value, nodes) for name, value in values.items()}

    def _check_selector(self, selector: SelectorRule, nodes: Mapping[str, Resource]) -> None:
        """Raise unless each tube is at the common port or at a number of its own."""
        valve = nodes[selector.role]
        count = int(self._value(selector.count, nodes))
        common = selector.common_port
        neither = "not" if common is None else f"neither {common!r} nor"
        used: dict[str, set[PortRef]] = {}
        for own, far in tubes_of(self.lab, valve):
            used.setdefault(own.port, set()).add(far)
        for port, far_ends in used.items():
            is_numbered = port.isascii() and port.isdigit() and 1 <= int(port) <= count
            if port != common and not is_numbered:
                raise LabFileError(
                    f"port {port!r} of {valve.key} is {neither} a number from 1 to {count}",
                    code="binding.port",
                )
            if len(far_ends) > 1:
                raise LabFileError(
                    f"port {port!r} of {valve.key} has {len(far_ends)} tubes", code="binding.port"
                )
