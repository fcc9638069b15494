"""The shape of lab.json, entry by entry; unknown fields are refused."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta

from labweb.domain.errors import Finding

SCHEMA = "labweb.lab/1"
"""Version of the file format that this package reads and writes."""

Key = Annotated[str, Meta(min_length=1, max_length=500)]
Name = Annotated[str, Meta(min_length=1, max_length=500)]
Positive = Annotated[float, Meta(gt=0, le=1e15)]
NotNegative = Annotated[float, Meta(ge=0, le=1e15)]
Length = Annotated[float, Meta(ge=0, le=1_000_000)]
Json = dict[str, Any]
Entry = TypeVar("Entry", bound=msgspec.Struct)


class _Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all entries."""


class MaterialEntry(_Strict, frozen=True, kw_only=True):
    """One of `materials`."""

    key: Key
    name: Name
    inchikey: Annotated[str, Meta(pattern=r"^[A-Z]{14}-[A-Z]{10}-[A-Z]$")] | None = None
    density_mg_ul: Positive | None = None
    concentration_mmol_l: Positive | None = None
    ph: Annotated[float, Meta(ge=-2, le=16)] | None = None
    hazards: list[Annotated[str, Meta(min_length=1, max_length=100)]] = msgspec.field(
        default_factory=list
    )
    groups: list[Key] = msgspec.field(default_factory=list)
    incompatible_with: list[Key] = msgspec.field(default_factory=list)
    """Keys of materials and names of groups."""


class LotEntry(_Strict, frozen=True, kw_only=True):
    """One of `lots`."""

    key: Key
    material: Key
    supplier: str | None = None
    number: str | None = None
    expires_on: Annotated[str, Meta(pattern=r"^\d{4}-\d{2}-\d{2}$")] | None = None
    purity: str | None = None
    phase: Literal["liquid", "solid", "gas"] = "liquid"
    """Liquids are counted in `contents`, solids and gases in `masses`."""


class PoseEntry(_Strict, frozen=True, kw_only=True):
    """Where a resource stands, relative to its parent."""

    x_mm: Annotated[float, Meta(ge=-1_000_000, le=1_000_000)]
    y_mm: Annotated[float, Meta(ge=-1_000_000, le=1_000_000)]
    z_mm: Annotated[float, Meta(ge=-1_000_000, le=1_000_000)]
    rotation_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


class ContentsEntry(_Strict, frozen=True, kw_only=True):
    """One lot in a vessel."""

    lot: Key
    amount_ul: Annotated[float, Meta(gt=0, le=999_999_999_999)]


class MassEntry(_Strict, frozen=True, kw_only=True):
    """One lot of a solid or a gas in a vessel."""

    lot: Key
    amount_mg: Annotated[float, Meta(gt=0, le=999_999_999_999)]


class ResourceEntry(_Strict, frozen=True, kw_only=True):
    """One of `resources`."""

    key: Key
    name: Name
    kind: str
    parent: Key | None
    pose: Json | None = None
    size_mm: tuple[Length, Length, Length] | None = None
    config: Json = msgspec.field(default_factory=dict)
    data: Json = msgspec.field(default_factory=dict)
    extra: Json = msgspec.field(default_factory=dict)
    contents: list[Any] = msgspec.field(default_factory=list)
    masses: list[Any] = msgspec.field(default_factory=list)


class EndEntry(_Strict, frozen=True, kw_only=True):
    """One end of a connection; an empty port is one that nobody named."""

    resource: Key
    port: Annotated[str, Meta(max_length=500)]


class ConnectionEntry(_Strict, frozen=True, kw_only=True):
    """One of `connections`."""

    key: Key
    source: EndEntry
    target: EndEntry
    medium: str
    is_two_way: bool
    dead_volume_ul: NotNegative | None = None
    extra: Json = msgspec.field(default_factory=dict)


class HostFileEntry(_Strict, frozen=True, kw_only=True):
    """One of `hosts`."""

    key: Key
    name: Name


class SimulatorEntry(_Strict, frozen=True, kw_only=True):
    """The simulated instrument of a device."""

    model: Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]
    settings: Json = msgspec.field(default_factory=dict)
    line: Key | None = None


class DeviceFileEntry(_Strict, frozen=True, kw_only=True):
    """One of `devices`."""

    key: Key
    name: Name
    host: Key
    driver: Annotated[str, Meta(pattern=r"^[a-z_][a-z0-9_]*(\.[a-z_][a-z0-9_]*)+:[A-Z]\w*$")]
    config: Json = msgspec.field(default_factory=dict)
    nodes: dict[Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")], Key] = msgspec.field(
        default_factory=dict
    )
    transport: Annotated[str, Meta(pattern=r"^[a-z][a-z0-9+.-]*:.+$")] | None = None
    simulator: SimulatorEntry | None = None


class TopEntry(_Strict, frozen=True, kw_only=True):
    """The file itself; the lists are read entry by entry."""

    schema: Literal["labweb.lab/1"]
    name: Name
    time_zone: Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_+-]*(/[A-Za-z0-9_+-]+)*$")]
    mode: Literal["sim", "live"]
    materials: list[Any] = msgspec.field(default_factory=list)
    lots: list[Any] = msgspec.field(default_factory=list)
    resources: list[Any]
    connections: list[Any] = msgspec.field(default_factory=list)
    hosts: list[Any] = msgspec.field(default_factory=list)
    devices: list[Any] = msgspec.field(default_factory=list)
    discovered: list[Key] = msgspec.field(default_factory=list)
    extra: Json = msgspec.field(default_factory=dict)


def read_entry(
    value: object, kind: type[Entry], subject: str, findings: list[Finding]
) -> Entry | None:
    """Read one object field by field, so that each wrong field gets its finding.

    Returns:
        The entry, or None when at least one finding was added.
    """
    if not isinstance(value, Mapping):
        findings.append(Finding("lab_file.shape", f"{subject}: not an object", subject))
        return None
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        blamed = _blame_fields(value, kind, subject)
        findings += blamed or [Finding("lab_file.shape", f"{subject}: {error}", subject)]
        return None


def _blame_fields(
    value: Mapping[Any, Any], kind: type[msgspec.Struct], subject: str
) -> list[Finding]:
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind)}
    findings = [_unknown(str(name), fields, subject) for name in value if name not in fields]
    for name, field in fields.items():
        if name not in value:
            if field.required:
                findings.append(_finding("lab_file.missing_field", subject, name, "is missing"))
            continue
        try:
            msgspec.convert(value[name], field.type)
        except msgspec.ValidationError as error:
            findings.append(_finding("lab_file.field", subject, name, str(error)))
    return findings


def _unknown(name: str, fields: Mapping[str, Any], subject: str) -> Finding:
    stem = name.rsplit("_", 1)[0]
    near = sorted(known for known in fields if known.startswith(f"{stem}_"))
    hint = f"; use {', '.join(near)}" if near else ""
    return _finding("lab_file.unknown_field", subject, name, f"is not a known field{hint}")


def _finding(code: str, subject: str, field: str, what: str) -> Finding:
    return Finding(code, f"{subject}: {field}: {what}", subject, {"field": field})
