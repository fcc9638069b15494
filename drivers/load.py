"""Loads an approved driver on an edge host, and calls it with checked arguments.

Only modules of this package are loaded, and only when their source is byte for byte the one
that was approved. This is the one place that turns a name into running code.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drivers.base import ActionMark, Driver, Report, StatusMark, before_acting
from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import inspect_file
from drivers.transports.base import Transport
from labweb.domain.enrollment.spec import DriverSpec, check_arguments, check_config
from labweb.domain.errors import (
    ConformanceError,
    DefinitionError,
    Effect,
    FrameError,
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
    if spec.findings or spec.class_name != class_name:
        raise ConformanceError(
            f"{module}: {class_name} is not a conforming driver", findings=spec.findings
        )
    if findings := check_config(spec, config):
        messages = "; ".join(finding.message for finding in findings)
        raise DefinitionError(messages, code="driver.config", findings=findings)
    found = getattr(importlib.import_module(module), class_name)
    if not (isinstance(found, type) and issubclass(found, Driver)):
        raise ConformanceError(f"{module}.{class_name} is not a Driver")
    driver = found(transport, config)
    driver.spec = spec
    return driver


def call_action(driver: Driver[Any, Any], name: str, arguments: Mapping[str, Any]) -> Report:
    """Run one action to its end and return its report.

    Raises:
        NotFoundError: No such action.
        PreconditionError: The arguments do not fit; nothing was sent.
        DeviceError: It failed; `effect` and `context["moved_ul"]` say how far it came.
    """
    method = _marked(driver, name, ActionMark)
    spec = _spec_of(driver)
    if findings := check_arguments(spec.action(name), arguments):
        messages = "; ".join(finding.message for finding in findings)
        raise PreconditionError(messages, code="driver.arguments", findings=findings)
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
