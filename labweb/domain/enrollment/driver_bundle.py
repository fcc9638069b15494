"""Driver source as it is approved, sent and loaded: the driver's file with what it shares.

A driver is its own module and every shared module of the package that it reaches by import:
`drivers.waiting` and the modules that begin with `_` beside it. Their names and texts, in
canonical JSON, are the bundle; its SHA-256 is the digest that an approval signs. One changed
byte in a shared module is another version of each driver that uses it. What is not in it is
the platform: `drivers.base`, `drivers.interfaces`, `drivers.transports` and `labweb.domain`
come with the release that is installed on the host.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.errors import ConformanceError

CLASSES = ("sensors", "connectors", "processing", "characterization", "logistics", "virtual")
"""Folders of the package that hold drivers."""

MAX_BUNDLE_BYTES = 4 * 1024 * 1024
MAX_MODULES = 32
PART_BYTES = 128 * 1024
"""Bytes of one piece on its way to a host."""

_MODEL = re.compile(rf"drivers\.(?:{'|'.join(CLASSES)})\.[a-z][a-z0-9_]{{0,60}}")
_SHARED = re.compile(rf"drivers\.waiting|drivers\.(?:{'|'.join(CLASSES)})\._[a-z0-9_]{{1,60}}")


def is_model(module: str) -> bool:
    """Say whether a dotted name is one of a driver, `drivers.<class>.<model>`.

    Example:
        >>> is_model("drivers.connectors.runze_sy03b"), is_model("drivers.base")
        (True, False)
    """
    return _MODEL.fullmatch(module) is not None


def is_shared(module: str) -> bool:
    """Say whether a module goes with the drivers that import it.

    Example:
        >>> is_shared("drivers.connectors._dt"), is_shared("drivers.transports.base")
        (True, False)
    """
    return _SHARED.fullmatch(module) is not None


def encode_bundle(modules: Mapping[str, str]) -> bytes:
    """Render modules by dotted name: the bytes that the digest is of."""
    return canonical(dict(modules))


def digest_of(modules: Mapping[str, str]) -> str:
    """Return the SHA-256 of a bundle, lower-case hex."""
    return hashlib.sha256(encode_bundle(modules)).hexdigest()


def decode_bundle(data: bytes, digest: str) -> dict[str, str]:
    """Read a bundle that has to have this digest.

    Raises:
        ConformanceError: It is larger than any, another one, or names a module that no
            bundle holds.
    """
    found = hashlib.sha256(data).hexdigest() if len(data) <= MAX_BUNDLE_BYTES else "too large"
    if found != digest:
        raise ConformanceError(
            f"the source is not the one with the digest {digest[:12]}",
            code="driver.digest",
            context={"approved": digest, "found": found},
        )
    try:
        modules = msgspec.json.decode(data, type=dict[str, str])
    except msgspec.MsgspecError as error:
        raise ConformanceError(f"the source is no bundle: {error}", code="driver.bundle") from error
    models = [name for name in modules if is_model(name)]
    others = [name for name in modules if not is_model(name) and not is_shared(name)]
    if len(models) != 1 or others or len(modules) > MAX_MODULES:
        raise ConformanceError(
            f"a bundle holds one driver and what it shares; here are {sorted(modules)[:8]}",
            code="driver.bundle",
        )
    return modules
