"""The rules DRV009 and DRV011: what driver source may import, and what it may not call.

The rules keep honest drivers honest. Reading text is no sandbox: what a driver can do is
bounded by the confined process that it runs in.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

from drivers.catalog.bundle import read_installed
from drivers.catalog.source import Source
from labweb.domain.enrollment.driver_bundle import is_shared
from labweb.domain.errors import ConformanceError, Finding

FORBIDDEN_MODULES = frozenset(
    {"socket", "serial", "pymodbus", "asyncio", "http", "urllib", "ftplib", "requests", "httpx"}
    | {"aiohttp", "websockets", "subprocess", "multiprocessing", "os", "shutil", "pathlib", "io"}
    | {"ctypes", "cffi", "importlib", "pickle", "marshal", "builtins", "sys", "usb", "pyvisa"}
    | {"smbus", "bleak", "paramiko", "telnetlib", "tempfile"}
)
"""Modules that open something, or run something; transports alone may."""

FORBIDDEN_CALLS = frozenset({"open", "eval", "exec", "compile", "__import__", "globals", "vars"})

ALLOWED_MODULES = frozenset(
    {"__future__", "abc", "array", "base64", "binascii", "bisect", "cmath", "collections"}
    | {"contextlib", "copy", "dataclasses", "datetime", "decimal", "enum", "fractions"}
    | {"functools", "hashlib", "heapq", "html", "itertools", "json", "logging", "math", "numbers"}
    | {"operator", "queue", "re", "statistics", "string", "struct", "textwrap", "threading"}
    | {"time", "types", "typing", "unicodedata", "uuid", "zlib", "msgspec"}
)
"""Modules of the standard library that compute and touch nothing, and msgspec."""

_PLATFORM = ("drivers.base", "drivers.interfaces", "drivers.transports", "labweb.domain")
"""Packages of the project that every host has; what a driver shares beside them is bundled."""


def check_imports(source: Source) -> Iterator[Finding]:
    """List what the source reaches for and may not."""
    for node in source.find(ast.Import, ast.ImportFrom, ast.Call):
        if name := _forbidden(node):
            yield source.finding(
                "drv009",
                node.lineno,
                f"{name} opens or runs something outside the transports",
                "take a transport in the constructor and use exchange() or send()",
            )
        elif isinstance(node, ast.Import):
            yield from _check_plain(source, node)
        elif isinstance(node, ast.ImportFrom):
            yield from _check_from(source, node)


def _forbidden(node: ast.Import | ast.ImportFrom | ast.Call) -> str:
    """Return the name of what the node reaches for, "" when it is allowed."""
    if isinstance(node, ast.Import):
        roots = [alias.name.partition(".")[0] for alias in node.names]
        return next((root for root in roots if root in FORBIDDEN_MODULES), "")
    if isinstance(node, ast.ImportFrom):
        root = (node.module or "").partition(".")[0]
        handed_on = [alias.name for alias in node.names] if _is_ours(node.module or "") else []
        return next((name for name in [root, *handed_on] if name in FORBIDDEN_MODULES), "")
    name = node.func.id if isinstance(node.func, ast.Name) else ""
    return name if name in FORBIDDEN_CALLS else ""


def _check_plain(source: Source, node: ast.Import) -> Iterator[Finding]:
    for alias in node.names:
        if _is_ours(alias.name):
            yield source.finding(
                "drv011",
                node.lineno,
                f"import {alias.name} binds the whole package",
                f"write: from {alias.name} import the names that you use",
            )
        elif alias.name.partition(".")[0] not in ALLOWED_MODULES:
            yield _stranger(source, node.lineno, alias.name)


def _check_from(source: Source, node: ast.ImportFrom) -> Iterator[Finding]:
    name = "." * node.level + (node.module or "")
    if any(alias.name == "*" for alias in node.names):
        yield source.finding(
            "drv011", node.lineno, f"from {name} import * hides what it takes", "name each thing"
        )
    elif node.level:
        yield source.finding(
            "drv011",
            node.lineno,
            f"the relative import {name} says no module",
            "write the module's whole name, drivers.<class>._<protocol>",
        )
    elif is_shared(name) and not _is_there(name):
        yield source.finding(
            "drv011",
            node.lineno,
            f"there is no module {name} in this release",
            "bring what you need into the driver's own file",
        )
    elif not _is_allowed(name):
        yield _stranger(source, node.lineno, name)


def _is_allowed(name: str) -> bool:
    if _is_ours(name):
        return is_shared(name) or any(
            name == known or name.startswith(f"{known}.") for known in _PLATFORM
        )
    return name.partition(".")[0] in ALLOWED_MODULES


def _is_ours(name: str) -> bool:
    return name.partition(".")[0] in {"drivers", "labweb"}


def _is_there(name: str) -> bool:
    try:
        read_installed(name)
    except ConformanceError:
        return False
    return True


def _stranger(source: Source, line: int, name: str) -> Finding:
    return source.finding(
        "drv011",
        line,
        f"{name} is not among the modules that a driver may import",
        "use msgspec, what computes in the standard library, or drivers.base, .interfaces, "
        ".transports, .waiting and the modules with _ beside the driver",
    )
