"""Files that actions hand over, and pictures that verdicts rest on: on disk before they count.

They lie in a folder of their line, which its confined process alone writes, until the server
has them.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from uuid import UUID

import msgspec

from drivers.base import DataFile
from labweb.domain.crutd.pre_and_postconditions import Condition, ConditionResult, ConditionVerdict
from labweb.domain.errors import LabError, StateError
from workers.base.valkey_store import ValkeyStore
from workers.line.device_unit import DeviceUnit

log = logging.getLogger(__name__)

MOST_WAITING = 2000
"""Files of one line that wait for the server; more are not taken."""

MOST_WAITING_BYTES = 2 * 2**30
"""What they may take of the disk."""

RESERVE_BYTES = 2**30
"""What files leave free of the disk, on which the journal lies too."""

Judged = Sequence[tuple[Condition, ConditionResult]]


@dataclass(frozen=True, slots=True)
class WaitingFile:
    """One file on disk, and what it belongs to."""

    path: Path
    action_id: UUID
    device_id: UUID
    sha256: str

    @property
    def size_bytes(self) -> int:
        """Return how large it is; 0 when it is gone by now."""
        try:
            return self.path.stat().st_size
        except OSError:
            return 0


class ActionFiles:
    """The folder of one line, which writes to it; the uplink reads and deletes."""

    def __init__(self, folder: Path) -> None:
        """Make the folder, which only this user may open, and clear what was half written."""
        self._folder = folder
        if not folder.is_dir():
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for draft in folder.glob(".*"):
            draft.unlink(missing_ok=True)

    def keep(self, action_id: UUID, device_id: UUID, sha256: str, data: bytes) -> Path:
        """Write a file to disk, whole or not at all, and return where it lies.

        Raises:
            StateError: `file.other_bytes`: the digest is not theirs; `file.no_room`: too many
                or too much waits here, or the disk refuses. Nothing was written.
        """
        if hashlib.sha256(data).hexdigest() != sha256:
            raise StateError("the bytes are not those that were seen", code="file.other_bytes")
        path = self._folder / f"{action_id}.{device_id}.{sha256}"
        if path.exists():
            return path
        self._refuse_beyond(len(data))
        draft = path.with_name(f".{path.name}")
        try:
            with draft.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            draft.replace(path)
            _sync(self._folder)
        except OSError as error:
            with contextlib.suppress(OSError):
                draft.unlink(missing_ok=True)
            raise StateError(f"the disk refuses a file: {error}", code="file.no_room") from error
        return path

    def waiting(self) -> list[WaitingFile]:
        """Return the files that the server does not have."""
        return sorted(_kept_in(self._folder), key=lambda one: one.path.name)

    def drop(self, path: Path) -> None:
        """Delete a file that does not count."""
        path.unlink(missing_ok=True)

    def _refuse_beyond(self, size_bytes: int) -> None:
        waiting = self.waiting()
        total_bytes = size_bytes + sum(one.size_bytes for one in waiting)
        if len(waiting) < MOST_WAITING and total_bytes <= MOST_WAITING_BYTES:
            self._refuse_reserve(size_bytes)
            return
        raise StateError(
            f"{len(waiting)} files wait for the server, with this one {total_bytes} bytes; at most "
            f"{MOST_WAITING} files and {MOST_WAITING_BYTES} bytes may: bring the server back",
            code="file.no_room",
        )

    def _refuse_reserve(self, size_bytes: int) -> None:
        """Leave the journal its room: without it the host cannot write down what it does."""
        free_bytes = shutil.disk_usage(self._folder).free
        if free_bytes - size_bytes >= RESERVE_BYTES:
            return
        raise StateError(
            f"the disk has {free_bytes} bytes free; after a file of {size_bytes} bytes "
            f"{RESERVE_BYTES} have to be left: make room on the host",
            code="file.no_room",
        )


class WaitingFiles:
    """The files of all lines, as the uplink sees them."""

    def __init__(self, folder: Path) -> None:
        """Make the folder of the lines' folders, and take in where pictures had waited."""
        self._folder = folder
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        before = folder.with_name("pictures")
        if before.is_dir() and not (folder / before.name).exists():
            before.rename(folder / before.name)

    def waiting(self) -> list[WaitingFile]:
        """Return the files that the server does not have."""
        found = [one for line in self._folder.iterdir() if line.is_dir() for one in _kept_in(line)]
        return sorted(found, key=lambda one: one.path.name)

    def has(self, action_id: UUID, device_id: UUID, sha256: str) -> bool:
        """Tell whether the bytes of a file are here."""
        return any(self._folder.glob(f"*/{action_id}.{device_id}.{sha256}"))

    def drop(self, kept: WaitingFile) -> None:
        """Delete a file that the server has, or does not want."""
        kept.path.unlink(missing_ok=True)


def _kept_in(folder: Path) -> Iterator[WaitingFile]:
    for path in folder.glob("[!.]*"):
        try:
            action_id, device_id, sha256 = path.name.split(".")
            kept = WaitingFile(path, UUID(action_id), UUID(device_id), sha256)
        except ValueError:
            _note_stray(path)
        else:
            yield kept


@lru_cache(maxsize=1000)
def _note_stray(path: Path) -> None:
    """Say once that something lies where only files that wait may lie."""
    log.error("%s is no file that waits for the server; it is left alone", path)


def _sync(folder: Path) -> None:
    """Have the names in a folder reach the disk too."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def share_picture(store: ValkeyStore, unit: DeviceUnit, value: object) -> None:
    """Put the picture behind a reading where other lines find it."""
    sha256 = value.get("image_sha256") if isinstance(value, Mapping) else None
    if not isinstance(sha256, str):
        return
    try:
        data = unit.picture(sha256)
    except LabError:
        return
    if data is not None:
        store.put_picture(sha256, data)


class PictureKeeper:
    """Sees to it that no verdict rests on a picture, and no answer on a file, that is not there."""

    def __init__(
        self, files: ActionFiles, units: Mapping[UUID, DeviceUnit], store: ValkeyStore | None
    ) -> None:
        self._files = files
        self._units = units
        self._store = store

    def back(self, action_id: UUID, judged: Judged) -> list[tuple[Condition, ConditionResult]]:
        """Keep the pictures behind the verdicts; one without its picture tells nothing."""
        return [(one, self._backed(action_id, one, result)) for one, result in judged]

    def keep_files(self, action_id: UUID, device_id: UUID, files: Sequence[DataFile]) -> None:
        """Keep what an action hands over, all of it or nothing.

        Raises:
            StateError: As `ActionFiles.keep`.
        """
        kept: list[Path] = []
        try:
            for file in files:
                path = self._files.keep(action_id, device_id, file.sha256, file.data)
                kept.append(path)
        except StateError:
            for path in kept:
                self._files.drop(path)
            raise

    def keep_reported(self, action_id: UUID, device_id: UUID, evidence: Mapping[str, Any]) -> None:
        """Keep the pictures that an action reports to have taken."""
        for value in evidence.values():
            sha256 = value.get("image_sha256") if isinstance(value, Mapping) else None
            if isinstance(sha256, str):
                self._keep(action_id, device_id, sha256)

    def _backed(
        self, action_id: UUID, condition: Condition, result: ConditionResult
    ) -> ConditionResult:
        sha256 = result.evidence.get("image_sha256")
        if condition.image_status is None or not isinstance(sha256, str):
            return result
        if self._keep(action_id, condition.device_id, sha256):
            return result
        text = f"the picture behind {condition.status} could not be kept"
        return msgspec.structs.replace(result, verdict=ConditionVerdict.UNOBSERVABLE, message=text)

    def _keep(self, action_id: UUID, device_id: UUID, sha256: str) -> bool:
        data = self._find(device_id, sha256)
        if data is None:
            return False
        try:
            self._files.keep(action_id, device_id, sha256, data)
        except StateError:
            return False
        return True

    def _find(self, device_id: UUID, sha256: str) -> bytes | None:
        find: Callable[[str], bytes | None] | None = None
        if device_id in self._units:
            find = self._units[device_id].picture
        elif self._store is not None:
            find = self._store.picture
        try:
            return None if find is None else find(sha256)
        except LabError:
            return None
