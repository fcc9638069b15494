"""Read labweb's own lab file, `lab.json`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from datetime import date
from typing import TypeVar
from uuid import UUID

import msgspec

from labweb.domain.errors import Finding, LabFileError
from labweb.domain.graph.lab_file.lab_check import check_lab, find_amount
from labweb.domain.graph.lab_file.lab_json_entries import (
    SCHEMA,
    ConnectionEntry,
    ContentsEntry,
    DeviceFileEntry,
    HostFileEntry,
    LotEntry,
    MassEntry,
    MaterialEntry,
    ResourceEntry,
    SimulatorEntry,
    TopEntry,
    read_entry,
)
from labweb.domain.graph.lab_file.lab_model import (
    DeviceEntry,
    HostEntry,
    LabFile,
    LabFileLot,
    LabFileMaterial,
    LabFileSimulator,
    LabMode,
    entry_id,
    lab_id,
)
from labweb.domain.graph.lab_file.resource_config import check_config
from labweb.domain.graph.lab_file.untrusted_json import MAX_NODES, decode_json, refuse, refuse_all
from labweb.domain.graph.ports_and_connections import Connection, Medium, PortRef
from labweb.domain.resources.contents_by_lot import LotId, Phase
from labweb.domain.resources.exact_volumes import to_nl
from labweb.domain.resources.labware.labware_resources import ids_in_labware
from labweb.domain.resources.pose import Pose, parse_pose
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS

_GAPS = frozenset({"tree.dangling_parent", "lab_file.root", "lab_file.dangling_end"})

Entry = TypeVar("Entry", bound=msgspec.Struct)
Item = TypeVar("Item")


def read_lab(raw: bytes) -> LabFile:
    """Read a lab file whole, or refuse it whole.

    Raises:
        LabFileError: Its findings list everything that is wrong, by entry and field.
            Nothing of the file may be used.
    """
    return read_decoded(decode_json(raw))


def read_decoded(value: object) -> LabFile:
    """Read what `decode_json` made of a lab file, in the same way."""
    if not isinstance(value, Mapping) or value.get("schema") != SCHEMA:
        raise refuse(
            "lab_file.schema", f'the file does not begin with "schema": "{SCHEMA}"', "schema"
        )
    findings: list[Finding] = []
    top = read_entry(value, TopEntry, "file", findings)
    if top is None:
        raise refuse_all(findings, "the lab file")
    return _Reader(top).read()


class _Reader:
    """One file on its way into a LabFile; findings gather as it goes."""

    def __init__(self, top: TopEntry) -> None:
        self.top = top
        self.lab = lab_id(top.name)
        self.findings: list[Finding] = []
        self.ids: dict[str, dict[str, UUID]] = {}

    def read(self) -> LabFile:
        materials = self._entries("materials", self.top.materials, MaterialEntry)
        lots = self._entries("lots", self.top.lots, LotEntry)
        resources = self._entries("resources", self.top.resources, ResourceEntry)
        connections = self._entries("connections", self.top.connections, ConnectionEntry)
        hosts = self._entries("hosts", self.top.hosts, HostFileEntry)
        devices = self._entries("devices", self.top.devices, DeviceFileEntry)
        sorts = {
            "material": self.top.materials,
            "lot": self.top.lots,
            "resource": self.top.resources,
            "host": self.top.hosts,
        }
        for sort, values in sorts.items():
            self.ids[sort] = {key: entry_id(self.lab, sort, key) for key in _keys(values)}
        kinds = {entry.key: entry.kind for entry in resources}
        self.ids["resource"] |= ids_in_labware(kinds, self.ids["resource"])
        lab = LabFile(
            id=self.lab,
            name=self.top.name,
            time_zone=self.top.time_zone,
            mode=LabMode(self.top.mode),
            materials=tuple(self._material(entry) for entry in materials),
            lots=self._each(lots, self._lot),
            resources=self._each(resources, self._resource),
            contents={
                self.ids["resource"][entry.key]: contents
                for entry in resources
                if (contents := self._contents(entry))
            },
            masses={
                self.ids["resource"][entry.key]: masses
                for entry in resources
                if (masses := self._masses(entry))
            },
            connections=self._each(connections, self._connection),
            hosts=tuple(
                HostEntry(id=self.ids["host"][entry.key], key=entry.key, name=entry.name)
                for entry in hosts
            ),
            devices=self._each(devices, self._device),
            discovered=tuple(self.top.discovered),
            extra=self.top.extra,
        )
        self._finish(lab)
        return lab

    def _finish(self, lab: LabFile) -> None:
        whole = check_lab(lab)
        if self.findings:
            # An entry that could not be read leaves gaps that are no mistakes of their own.
            whole = [finding for finding in whole if finding.code not in _GAPS]
        findings = [*self.findings, *whole]
        if findings:
            raise refuse_all(findings, f"the lab file {self.top.name!r}")

    def _entries(self, sort: str, values: list[object], kind: type[Entry]) -> list[Entry]:
        if len(values) > MAX_NODES:
            message = f"{sort} has {len(values)} entries; at most {MAX_NODES} are read"
            raise refuse("lab_file.too_many", message, sort)
        found = []
        for index, value in enumerate(values):
            entry = read_entry(value, kind, _subject(sort, index, value), self.findings)
            if entry is not None:
                found.append(entry)
        return found

    def _each(
        self, entries: Iterable[Entry], build: Callable[[Entry], Item | None]
    ) -> tuple[Item, ...]:
        return tuple(item for entry in entries if (item := build(entry)) is not None)

    def _wrong(self, code: str, subject: str, field: str, what: str) -> None:
        self.findings.append(
            Finding(code, f"{subject}: {field}: {what}", subject, {"field": field})
        )

    def _find(self, sort: str, key: str, subject: str, field: str) -> UUID | None:
        found = self.ids[sort].get(key)
        if found is None:
            self._wrong("lab_file.dangling", subject, field, f"no {sort} {key!r} in the file")
        return found

    def _material(self, entry: MaterialEntry) -> LabFileMaterial:
        return LabFileMaterial(
            id=self.ids["material"][entry.key],
            key=entry.key,
            name=entry.name,
            inchikey=entry.inchikey,
            density_mg_ul=entry.density_mg_ul,
            concentration_mmol_l=entry.concentration_mmol_l,
            ph=entry.ph,
            hazards=tuple(entry.hazards),
            groups=tuple(entry.groups),
            incompatible_with=tuple(entry.incompatible_with),
        )

    def _lot(self, entry: LotEntry) -> LabFileLot | None:
        subject = f"lots[{entry.key!r}]"
        if entry.expires_on is not None:
            try:
                date.fromisoformat(entry.expires_on)
            except ValueError:
                self._wrong("lab_file.field", subject, "expires_on", "is no day of the calendar")
        material = self._find("material", entry.material, subject, "material")
        if material is None:
            return None
        return LabFileLot(
            id=self.ids["lot"][entry.key],
            key=entry.key,
            material_id=material,
            supplier=entry.supplier,
            number=entry.number,
            expires_on=entry.expires_on,
            purity=entry.purity,
            phase=Phase(entry.phase),
        )

    def _resource(self, entry: ResourceEntry) -> Resource | None:
        subject = f"resources[{entry.key!r}]"
        parent_id = None
        if entry.parent is not None:
            parent_id = self._find("resource", entry.parent, subject, "parent")
        if entry.kind not in KINDS:
            self.findings += check_config(entry.kind, entry.config, subject)
            return None
        return Resource(
            id=self.ids["resource"][entry.key],
            key=entry.key,
            name=entry.name,
            kind=entry.kind,
            nature=KINDS[entry.kind].nature,
            parent_id=parent_id,
            pose=self._pose(entry, subject),
            size_mm=entry.size_mm,
            config=entry.config,
            data=entry.data,
            extra=entry.extra,
        )

    def _pose(self, entry: ResourceEntry, subject: str) -> Pose | None:
        if entry.pose is None:
            return None
        known = {"x_mm", "y_mm", "z_mm", "rotation_wxyz"}
        for field in sorted(set(entry.pose) - known):
            self._wrong("lab_file.unknown_field", f"{subject}.pose", field, "is not a known field")
        numbers = [entry.pose.get(name) for name in ("x_mm", "y_mm", "z_mm")]
        rotation = entry.pose.get("rotation_wxyz", [1, 0, 0, 0])
        parts = [*numbers, *rotation] if isinstance(rotation, list) else [None]
        if not all(type(part) in (int, float) for part in parts):
            what = "wants numbers x_mm, y_mm, z_mm and four of rotation_wxyz"
            self._wrong("lab_file.field", subject, "pose", what)
            return None
        try:
            return parse_pose(entry.pose)
        except LabFileError as error:
            self._wrong(error.code, subject, "pose", error.message)
            return None

    def _contents(self, entry: ResourceEntry) -> dict[LotId, int]:
        found: dict[LotId, int] = {}
        for index, value in enumerate(entry.contents):
            subject = f"resources[{entry.key!r}].contents[{index}]"
            part = read_entry(value, ContentsEntry, subject, self.findings)
            if part is not None:
                self._pour(found, part.lot, (part.amount_ul, "amount_ul"), subject)
        return found

    def _masses(self, entry: ResourceEntry) -> dict[LotId, int]:
        found: dict[LotId, int] = {}
        for index, value in enumerate(entry.masses):
            subject = f"resources[{entry.key!r}].masses[{index}]"
            part = read_entry(value, MassEntry, subject, self.findings)
            if part is not None:
                self._pour(found, part.lot, (part.amount_mg, "amount_mg"), subject)
        return found

    def _pour(
        self, found: dict[LotId, int], key: str, given: tuple[float, str], subject: str
    ) -> None:
        lot = self._find("lot", key, subject, "lot")
        value, field = given
        amount = find_amount(value)
        if amount is None:
            unit = "nanolitres" if field == "amount_ul" else "micrograms"
            what = f"{value} {'µL' if field == 'amount_ul' else 'mg'} is no whole number of {unit}"
            self._wrong("lab_file.off_grid", subject, field, what)
        elif lot is not None and str(lot) in found:
            self._wrong("lab_file.duplicate", subject, "lot", f"{key!r} stands twice")
        elif lot is not None:
            found[LotId(str(lot))] = amount

    def _connection(self, entry: ConnectionEntry) -> Connection | None:
        subject = f"connections[{entry.key!r}]"
        source = self._find("resource", entry.source.resource, subject, "source")
        target = self._find("resource", entry.target.resource, subject, "target")
        if entry.medium not in set(Medium):
            what = f"{entry.medium!r} is not one of {', '.join(Medium)}"
            self._wrong("lab_file.field", subject, "medium", what)
            return None
        dead_nl = None
        if entry.dead_volume_ul is not None:
            dead_nl = to_nl(entry.dead_volume_ul, 1000)
            if dead_nl is None:
                what = f"{entry.dead_volume_ul} µL is no whole number of nanolitres"
                self._wrong("lab_file.off_grid", subject, "dead_volume_ul", what)
        if source is None or target is None:
            return None
        return Connection(
            id=entry_id(self.lab, "connection", entry.key),
            key=entry.key,
            source=PortRef(source, entry.source.port),
            target=PortRef(target, entry.target.port),
            medium=Medium(entry.medium),
            is_two_way=entry.is_two_way,
            dead_volume_nl=dead_nl,
            extra=entry.extra,
        )

    def _device(self, entry: DeviceFileEntry) -> DeviceEntry | None:
        subject = f"devices[{entry.key!r}]"
        host = self._find("host", entry.host, subject, "host")
        nodes = {
            role: self._find("resource", key, subject, f"nodes.{role}")
            for role, key in entry.nodes.items()
        }
        if host is None:
            return None
        return DeviceEntry(
            id=entry_id(self.lab, "device", entry.key),
            key=entry.key,
            name=entry.name,
            host_id=host,
            driver=entry.driver,
            config=entry.config,
            nodes={role: found for role, found in nodes.items() if found is not None},
            transport=entry.transport,
            simulator=None if entry.simulator is None else _simulator(entry.simulator),
        )


def _simulator(entry: SimulatorEntry) -> LabFileSimulator:
    return LabFileSimulator(model=entry.model, settings=entry.settings, line=entry.line)


def _keys(values: list[object]) -> list[str]:
    """Return the keys that are there, also of entries that are wrong elsewhere."""
    keys = [value.get("key") for value in values if isinstance(value, Mapping)]
    return [key for key in keys if isinstance(key, str)]


def _subject(sort: str, index: int, value: object) -> str:
    key = value.get("key") if isinstance(value, Mapping) else None
    return f"{sort}[{key!r}]" if isinstance(key, str) and key else f"{sort}[{index}]"
