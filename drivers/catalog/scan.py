"""Finds driver modules and reads each into a `DriverSpec` with its findings."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec

from drivers.catalog.conformance import check_driver, check_module
from drivers.catalog.inspect import PACKAGE, build_spec, device_classes, read_class
from drivers.catalog.source import Source, read_source
from labweb.domain.enrollment.spec import DriverSpec
from labweb.domain.errors import ConformanceError, Finding

MAX_FILES = 2000
"""Most files that one scan reads."""

_NOT_DEVICES = frozenset({"catalog", "interfaces", "transports"})


class Catalog(msgspec.Struct, frozen=True, kw_only=True):
    """What a scan found."""

    version: int = 1
    drivers: tuple[DriverSpec, ...] = ()
    findings: tuple[Finding, ...] = ()
    """Files that could not be read; what breaks a rule stands in the driver's own findings."""

    @property
    def all_findings(self) -> tuple[Finding, ...]:
        """Return every finding, of files and of drivers."""
        of_drivers = (finding for spec in self.drivers for finding in spec.findings)
        return (*self.findings, *of_drivers)


def scan(path: Path) -> Catalog:
    """Read a file, or every driver module below a folder. Nothing is imported.

    Example:
        >>> from drivers.catalog.inspect import PACKAGE
        >>> [spec.class_name for spec in scan(PACKAGE / "virtual").drivers]
        ['HostTimer']
    """
    specs: list[DriverSpec] = []
    findings: list[Finding] = []
    for file in _files(path):
        try:
            source = read_source(file)
            if path.is_file() or device_classes(source.tree):
                specs.extend(_inspect(source))
        except ConformanceError as error:
            findings.extend(error.findings)
    return Catalog(drivers=tuple(specs), findings=tuple(findings))


def inspect_file(path: Path) -> DriverSpec:
    """Read the one driver of a file.

    Raises:
        ConformanceError: The file cannot be read, or holds no device class, or several.
    """
    source = read_source(path)
    specs = _inspect(source)
    if len(specs) != 1:
        message = f"{path} holds {len(specs)} device classes, not one"
        raise ConformanceError(message, findings=check_module(source))
    return specs[0]


def _inspect(source: Source) -> list[DriverSpec]:
    try:
        return _inspect_all(source)
    except (RecursionError, MemoryError) as error:
        finding = source.finding("source_too_deep", 1, "is nested too deeply", "flatten it")
        raise ConformanceError(finding.message, findings=[finding]) from error


def _inspect_all(source: Source) -> list[DriverSpec]:
    shared = check_module(source)
    nodes = device_classes(source.tree)
    if not nodes:
        raise ConformanceError(f"{source.path} holds no device class", findings=shared)
    specs = []
    for node in nodes:
        driver = read_class(source, node)
        findings = sorted((*shared, *check_driver(driver)), key=_place)
        specs.append(msgspec.structs.replace(build_spec(driver), findings=tuple(findings)))
    return specs


def _place(finding: Finding) -> tuple[int, str]:
    return finding.context["line"], finding.code


def _files(path: Path) -> Iterator[Path]:
    if path.is_file():
        yield path
        return
    found = sorted(path.rglob("*.py"))[:MAX_FILES]
    yield from (file for file in found if _may_hold_driver(file))


def _may_hold_driver(file: Path) -> bool:
    try:
        inside = file.resolve().relative_to(PACKAGE).parts
    except ValueError:
        return True
    is_private = file.name.startswith("_")
    return len(inside) > 1 and inside[0] not in _NOT_DEVICES and not is_private
