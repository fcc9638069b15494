"""Finds driver modules and reads each into a `DriverSpec` with its findings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from drivers.catalog.bundle import Reader, digest_for, gather, read_installed
from drivers.catalog.conformance import check_driver, check_module
from drivers.catalog.inspect import PACKAGE, build_spec, device_classes, read_class
from drivers.catalog.source import Source, check_words, parse_source, read_source
from labweb.domain.enrollment.driver_bundle import CLASSES, is_model
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import ConformanceError, Finding

MAX_FILES = 2000
"""Most files that one scan reads."""

_NOT_DEVICES = frozenset({"catalog", "interfaces", "new", "transports"})


class Catalog(msgspec.Struct, frozen=True, kw_only=True):
    """What a scan found."""

    version: int = 1
    drivers: tuple[DriverSpec, ...] = ()
    findings: tuple[Finding, ...] = ()
    """Files that could not be read; what breaks a rule stands in the driver's own findings."""

    sources: dict[str, dict[str, str]] = msgspec.field(default_factory=dict)
    """Bundle of each driver by its digest: texts by dotted name."""

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
    found: list[InspectedDriver] = []
    findings: list[Finding] = []
    for file in _files(path):
        try:
            source = read_source(file)
            if path.is_file() or device_classes(source.tree):
                found.extend(_inspect(source))
        except ConformanceError as error:
            findings.extend(error.findings)
    return _catalog(found, findings)


def scan_text(module: str, data: bytes) -> Catalog:
    """Read the text of one driver that shall have this name in the package.

    Example:
        >>> scan_text("drivers.virtual.none", b"x = 1").findings[0].code
        'driver.drv001'
    """
    try:
        if not is_model(module):
            raise ConformanceError(f"{module!r} is no name", findings=[_no_name(module)])
        check_words(_file(module), data)
        return _catalog(_inspect(_parse(module, data)), [])
    except ConformanceError as error:
        return Catalog(findings=error.findings)


def inspect_bundle(modules: Mapping[str, str]) -> DriverSpec:
    """Read the one driver of a bundle; its shared modules are taken from the bundle alone.

    Raises:
        ConformanceError: It cannot be read, or holds no device class, or several.
    """
    (module,) = (name for name in modules if is_model(name))

    def read(name: str) -> Source:
        if name not in modules:
            raise ConformanceError(f"the bundle lacks {name}", code="driver.bundle")
        return _parse(name, modules[name].encode())

    source = _parse(module, modules[module].encode())
    return _only(source, _inspect(source, read))


def _parse(module: str, data: bytes) -> Source:
    """Parse a text; findings name the file as it would lie in a checkout."""
    return parse_source(_file(module), data, module)


def _file(module: str) -> Path:
    return Path(*module.split(".")).with_suffix(".py")


class InspectedDriver(msgspec.Struct, frozen=True):
    """One driver with the texts that its digest is of."""

    spec: DriverSpec
    texts: dict[str, str]


def _catalog(found: list[InspectedDriver], findings: Sequence[Finding]) -> Catalog:
    return Catalog(
        drivers=tuple(one.spec for one in found),
        findings=tuple(findings),
        sources={one.spec.digest: one.texts for one in found},
    )


def _no_name(module: str) -> Finding:
    return Finding(
        "driver.no_module",
        f"{module!r} names no driver",
        subject=module,
        context={
            "file": module,
            "line": 1,
            "suggestion": f"drivers.<class>.<model>; classes are {', '.join(CLASSES)}",
        },
    )


def inspect_file(path: Path) -> DriverSpec:
    """Read the one driver of a file.

    Raises:
        ConformanceError: The file cannot be read, or holds no device class, or several.
    """
    source = read_source(path)
    return _only(source, _inspect(source))


def _only(source: Source, found: list[InspectedDriver]) -> DriverSpec:
    if len(found) != 1:
        message = f"{source.path} holds {len(found)} device classes, not one"
        raise ConformanceError(message, findings=check_module(source))
    return found[0].spec


def _inspect(source: Source, read: Reader = read_installed) -> list[InspectedDriver]:
    try:
        return _inspect_all(source, read)
    except (RecursionError, MemoryError) as error:
        finding = source.finding("source_too_deep", 1, "is nested too deeply", "flatten it")
        raise ConformanceError(finding.message, findings=[finding]) from error


def _inspect_all(source: Source, read: Reader) -> list[InspectedDriver]:
    shared = check_module(source)
    nodes = device_classes(source.tree)
    if not nodes:
        raise ConformanceError(f"{source.path} holds no device class", findings=shared)
    texts = gather(source, read)
    digest = digest_for(source, texts)
    specs = []
    for node in nodes:
        driver = read_class(source, node)
        findings = tuple(sorted((*shared, *check_driver(driver)), key=_place))
        spec = msgspec.structs.replace(build_spec(driver), digest=digest, findings=findings)
        specs.append(InspectedDriver(spec, texts))
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
