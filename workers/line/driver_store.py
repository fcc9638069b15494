"""The drivers of a host: those that are installed, and those that the server sent.

What the server sent lies in `drivers/DIGEST.json` of the host's folder, with its approval.
It is checked when it comes and each time that it is loaded: one changed byte, and it is no
driver any more.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from drivers.base import Driver
from drivers.load import load_bundle, load_driver, read_spec
from drivers.transports.base import Transport
from labweb.domain.enrollment.driver_bundle import (
    decode_bundle,
    digest_of,
    encode_bundle,
)
from labweb.domain.errors import ConformanceError
from labweb.domain.messages.devices_and_drivers import DeviceConfig, DriverApproval, Signed
from workers.base.signatures import is_signed

UPLOAD, RELEASE = "upload", "release"


class _Kept(msgspec.Struct, frozen=True):
    """What one file of the store holds."""

    approval: Signed
    modules: dict[str, str]


def check_approval(approval: Signed, digest: str, keys: Mapping[str, str]) -> DriverApproval:
    """Read an approval that the server signed for this digest.

    Raises:
        ConformanceError: No known key signed it, it is of another digest, or an upload was
            approved by nobody, or by who brought it.
    """
    if not is_signed(approval, keys):
        raise ConformanceError("no known key signed the approval", code="driver.unsigned")
    try:
        found = msgspec.json.decode(approval.body, type=DriverApproval)
    except msgspec.MsgspecError as error:
        text = f"what was signed is no approval: {error}"
        raise ConformanceError(text, code="driver.unsigned") from error
    people = {found.proposed_by, found.approved_by}
    is_vouched = found.origin == RELEASE or (
        found.origin == UPLOAD and len(people) == 2 and "" not in people
    )
    if found.digest != digest or not is_vouched:
        raise ConformanceError(
            f"the approval is not of {digest[:12]} by a second person", code="driver.unsigned"
        )
    return found


class DriverStore:
    """The bundles of one host, on disk."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def path(self, digest: str) -> Path:
        """Return where a bundle lies, or would lie."""
        if len(digest) != 64 or not set(digest) <= set("0123456789abcdef"):
            raise ConformanceError(f"{digest[:80]!r} is no digest", code="driver.digest")
        return self._folder / f"{digest}.json"

    def has(self, digest: str) -> bool:
        """Say whether a bundle is on disk."""
        return self.path(digest).is_file()

    def keep(self, digest: str, data: bytes, approval: Signed, keys: Mapping[str, str]) -> None:
        """Check a bundle and put it on disk, whole and durably, or not at all.

        Raises:
            ConformanceError: It is not what was approved; nothing was written.
        """
        check_approval(approval, digest, keys)
        kept = msgspec.json.encode(_Kept(approval, decode_bundle(data, digest)))
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        path = self.path(digest)
        fresh = path.with_suffix(".new")
        descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(kept)
            stream.flush()
            os.fsync(stream.fileno())
        fresh.replace(path)
        folder = os.open(self._folder, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def read(self, digest: str, keys: Mapping[str, str]) -> dict[str, str]:
        """Return the texts of a bundle, after checking digest and approval again.

        Raises:
            ConformanceError: It is not here, damaged, or not what was approved.
        """
        try:
            kept = msgspec.json.decode(self.path(digest).read_bytes(), type=_Kept)
        except OSError as error:
            text = f"the source of {digest[:12]} is not on this host: {error.strerror}"
            raise ConformanceError(text, code="driver.no_module") from error
        except msgspec.MsgspecError as error:
            text = f"the source of {digest[:12]} is damaged: {error}"
            raise ConformanceError(text, code="driver.digest") from error
        check_approval(kept.approval, digest, keys)
        if digest_of(kept.modules) != digest:
            text = f"the source on disk is not the one with the digest {digest[:12]}"
            raise ConformanceError(text, code="driver.digest")
        return decode_bundle(encode_bundle(kept.modules), digest)


@cache
def is_installed(module: str, digest: str) -> bool:
    """Say whether the release on this host has exactly this version."""
    try:
        return read_spec(module).digest == digest
    except ConformanceError:
        return False


class DriverLoader:
    """Loads the drivers of a host's devices."""

    def __init__(self, store: DriverStore, keys: Mapping[str, str]) -> None:
        self._store = store
        self._keys = keys

    def load(self, device: DeviceConfig, transport: Transport) -> Driver[Any, Any]:
        """Build the driver of a device; nothing is opened.

        Raises:
            LabError: It is not here, is not what was approved, or cannot be built.
        """
        if is_installed(device.module, device.digest) or not self._store.has(device.digest):
            return load_driver(
                device.module, device.class_name, device.digest, transport, device.config
            )
        modules = self._store.read(device.digest, self._keys)
        if device.module not in modules:
            text = f"{device.module} is not what was approved as {device.digest[:12]}"
            raise ConformanceError(text, code="driver.digest")
        return load_bundle(modules, device.class_name, transport, device.config)
