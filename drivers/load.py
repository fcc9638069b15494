"""Loads an approved driver on an edge host, and calls it with checked arguments.

A driver comes from this package, or from a bundle that the server sent; either way only when
its source, and that of what it shares, is byte for byte the one that was approved. This is
the one place that turns a name into running code.
"""

from __future__ import annotations

import ast
import importlib
import re
import sys
from collections.abc import Mapping
from functools import partial
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from drivers.base import ActionMark, Driver, Report, StatusMark, before_acting
from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import inspect_bundle, inspect_file
from drivers.readback import reading_back
from drivers.transports.base import Transport
from labweb.domain.enrollment.driver_spec import DriverSpec, check_arguments, check_config
from labweb.domain.enrollment.setpoint_readback import kept_by
from labweb.domain.errors import (
    ConformanceError,
    DefinitionError,
    Effect,
    FrameError,
    LabError,
    NotFoundError,
    PreconditionError,
)

_MODULE = re.compile(r"drivers(\.[a-z][a-z0-9_]*){2}")


def source_path(module: str) -> Path:
    """Return the file of a driver module of this package.

    Raises:
        ConformanceError: The name is not `drivers.<class>.<model>`, or has no file.
    """
    parts = module.split(".")
    path = PACKAGE.joinpath(*parts[1:]).with_suffix(".py")
    if not _MODULE.fullmatch(module) or path.is_symlink() or not path.is_file():
        raise ConformanceError(f"{module!r} is no driver module here", code="driver.no_module")
    return path


def read_spec(module: str) -> DriverSpec:
    """Read what a driver of this package declares; nothing is imported.

    Raises:
        ConformanceError: No such module, or it cannot be read.
    """
    return inspect_file(source_path(module))


def load_driver(
    module: str, class_name: str, digest: str, transport: Transport, config: Mapping[str, Any]
) -> Driver[Any, Any]:
    """Build a driver from source that somebody approved. Nothing is opened and nothing is sent.

    Args:
        module: Dotted name, `drivers.connectors.tricontinent_c3000`.
        class_name: The class that was approved.
        digest: SHA-256 of the approved source, lower-case hex.
        transport: Line of the device; drivers on one line share it.
        config: Settings of the device.

    Raises:
        ConformanceError: The source differs from the approved one, breaks a rule, or has no
            such class.
        DefinitionError: Settings or transport do not fit; `findings` list the settings.
    """
    spec = read_spec(module)
    if spec.digest != digest:
        raise ConformanceError(
            f"{module} is not the source that was approved",
            code="driver.digest",
            context={"approved": digest, "found": spec.digest},
        )
    _check_spec(spec, class_name, config)
    found = getattr(importlib.import_module(module), class_name)
    return _build(spec, found, transport, config)


def load_bundle(
    modules: Mapping[str, str], class_name: str, transport: Transport, config: Mapping[str, Any]
) -> Driver[Any, Any]:
    """Build a driver from a bundle whose digest and approval were checked. Nothing is opened.

    Its modules run under names of their own, so that two versions do not meet.

    Args:
        modules: Texts by dotted name, as `decode_bundle` returns them.
        class_name: The class that was approved.
        transport: Line of the device; drivers on one line share it.
        config: Settings of the device.

    Raises:
        ConformanceError: The source breaks a rule, cannot be imported, or has no such class.
        DefinitionError: Settings or transport do not fit; `findings` list the settings.
    """
    spec = inspect_bundle(modules)
    _check_spec(spec, class_name, config)
    try:
        found = getattr(_Bundled.module(modules, spec.digest, spec.module), class_name)
    except (Exception, SystemExit) as error:
        raise ConformanceError(
            f"{spec.module} cannot be imported: {type(error).__name__}: {error}",
            code="driver.import",
        ) from error
    return _build(spec, found, transport, config)


def _check_spec(spec: DriverSpec, class_name: str, config: Mapping[str, Any]) -> None:
    if spec.findings or spec.class_name != class_name:
        raise ConformanceError(
            f"{spec.module}: {class_name} is not a conforming driver", findings=spec.findings
        )
    if findings := check_config(spec, config):
        messages = "; ".join(finding.message for finding in findings)
        raise DefinitionError(messages, code="driver.config", findings=findings)


def _build(
    spec: DriverSpec, found: object, transport: Transport, config: Mapping[str, Any]
) -> Driver[Any, Any]:
    if not (isinstance(found, type) and issubclass(found, Driver)):
        raise ConformanceError(f"{spec.module}.{spec.class_name} is not a Driver")
    try:
        driver = found(transport, config)
    except LabError:
        raise
    except (Exception, SystemExit) as error:
        raise ConformanceError(
            f"{spec.class_name} cannot be built: {type(error).__name__}: {error}",
            code="driver.build",
        ) from error
    driver.spec = spec
    return driver


class _Bundled(MetaPathFinder, Loader):
    """Gives the modules of one bundle to Python's import, each under a name with the digest.

    What a bundle imports of itself is renamed in its tree; lines stay where they are.
    """

    def __init__(self, modules: Mapping[str, str], digest: str) -> None:
        self._names = {name: f"driver_{digest[:16]}.{name}"[:200] for name in modules}
        self._names = {name: new.replace(".", "_") for name, new in self._names.items()}
        self._texts = {self._names[name]: text for name, text in modules.items()}

    @classmethod
    def module(cls, modules: Mapping[str, str], digest: str, name: str) -> ModuleType:
        """Import the module of that name of the bundle."""
        finder = cls(modules, digest)
        sys.meta_path.insert(0, finder)
        try:
            return importlib.import_module(finder._names[name])
        finally:
            sys.meta_path.remove(finder)

    def find_spec(
        self, name: str, path: object = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Claim the modules of the bundle, and no other."""
        del path, target
        return ModuleSpec(name, self, origin="bundle") if name in self._texts else None

    def exec_module(self, module: ModuleType) -> None:
        """Run the text of a module."""
        tree = ast.parse(self._texts[module.__name__])
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module in self._names:
                node.module = self._names[node.module]
        exec(compile(tree, module.__name__, "exec"), vars(module))  # noqa: S102 - was approved


def call_action(driver: Driver[Any, Any], name: str, arguments: Mapping[str, Any]) -> Report:
    """Run one action to its end and return its report.

    While it waits, what it has set is read back: see `drivers.readback`.

    Raises:
        NotFoundError: No such action.
        PreconditionError: The arguments do not fit; nothing was sent.
        DeviceError: It failed; `effect` and `context["moved_ul"]` say how far it came. What was
            set is gone: `device.setpoint_lost`, `device.stalled`.
    """
    method = _marked(driver, name, ActionMark)
    spec = _spec_of(driver)
    if findings := check_arguments(spec.action(name), arguments):
        messages = "; ".join(finding.message for finding in findings)
        raise PreconditionError(messages, code="driver.arguments", findings=findings)
    statuses = frozenset(status.name for status in spec.statuses)
    with reading_back(driver, kept_by(name, arguments, statuses), partial(read_status, driver)):
        report = method(**arguments)
    if not isinstance(report, Report):
        raise FrameError(f"{name} returned no report", effect=Effect.UNKNOWN)
    return report


def read_status(driver: Driver[Any, Any], name: str) -> Any:  # noqa: ANN401 - any JSON value
    """Ask for one status.

    Raises:
        NotFoundError: No such status.
        DeviceError: It cannot be read; the effect is NONE.
    """
    with before_acting():
        return _marked(driver, name, StatusMark)()


def read_statuses(driver: Driver[Any, Any]) -> dict[str, Any]:
    """Ask for every status, in the order the source declares them.

    Raises:
        DeviceError: One of them cannot be read; the effect is NONE.
    """
    return {status.name: read_status(driver, status.name) for status in _spec_of(driver).statuses}


def _spec_of(driver: Driver[Any, Any]) -> DriverSpec:
    if driver.spec is None:
        driver.spec = read_spec(type(driver).__module__)
    return driver.spec


def _marked(driver: Driver[Any, Any], name: str, mark: type) -> Any:  # noqa: ANN401 - a method
    method = getattr(type(driver), name, None)
    left = {type(value) for value in getattr(method, "__dict__", {}).values()}
    if mark not in left:
        raise NotFoundError(f"{type(driver).__name__} has no {name!r}", code="driver.no_such")
    return getattr(driver, name)
