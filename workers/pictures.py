"""Pictures that verdicts rest on: on disk before a verdict counts, until the server has them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.crutd.conditions import Condition, Result, Verdict
from labweb.domain.errors import LabError
from workers.store import Store
from workers.unit import Unit

MOST_WAITING = 2000
"""Pictures that wait for the server; more are not taken, and their verdicts do not count."""

Judged = Sequence[tuple[Condition, Result]]


@dataclass(frozen=True, slots=True)
class Kept:
    """One picture on disk, and what it is evidence of."""

    path: Path
    action_id: UUID
    device_id: UUID
    sha256: str


class Pictures:
    """The folder of pictures of one host; its lines write, its uplink reads and deletes."""

    def __init__(self, folder: Path) -> None:
        """Make the folder, which only this user may open."""
        self._folder = folder
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)

    def keep(self, action_id: UUID, device_id: UUID, sha256: str, data: bytes | None) -> bool:
        """Write a picture to disk; False: it is not the one that was seen, or cannot be kept."""
        if data is None or hashlib.sha256(data).hexdigest() != sha256:
            return False
        path = self._folder / f"{action_id}.{device_id}.{sha256}"
        draft = path.with_name(f".{path.name}")
        try:
            if path.exists():
                return True
            if len(self.waiting()) >= MOST_WAITING:
                return False
            with draft.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            draft.replace(path)
        except OSError:
            return False
        return True

    def waiting(self) -> list[Kept]:
        """Return the pictures that the server does not have, oldest first."""
        found = []
        for path in self._folder.glob("[!.]*"):
            parts = path.name.split(".")
            if len(parts) == 3:
                found.append(Kept(path, UUID(parts[0]), UUID(parts[1]), parts[2]))
        return sorted(found, key=lambda one: one.path.name)

    def drop(self, kept: Kept) -> None:
        """Delete a picture that the server has, or does not want."""
        kept.path.unlink(missing_ok=True)


def share_picture(store: Store, unit: Unit, value: object) -> None:
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


class Witness:
    """Sees to it that no verdict rests on a picture that nobody can show."""

    def __init__(self, pictures: Pictures, units: Mapping[UUID, Unit], store: Store | None) -> None:
        self._pictures = pictures
        self._units = units
        self._store = store

    def back(self, action_id: UUID, judged: Judged) -> list[tuple[Condition, Result]]:
        """Keep the pictures behind the verdicts; one without its picture tells nothing."""
        return [(one, self._backed(action_id, one, result)) for one, result in judged]

    def keep_reported(self, action_id: UUID, device_id: UUID, evidence: Mapping[str, Any]) -> None:
        """Keep the pictures that an action reports to have taken."""
        for value in evidence.values():
            sha256 = value.get("image_sha256") if isinstance(value, Mapping) else None
            if isinstance(sha256, str):
                self._keep(action_id, device_id, sha256)

    def _backed(self, action_id: UUID, condition: Condition, result: Result) -> Result:
        sha256 = result.evidence.get("image_sha256")
        if condition.image_status is None or not isinstance(sha256, str):
            return result
        if self._keep(action_id, condition.device_id, sha256):
            return result
        text = f"the picture behind {condition.status} could not be kept"
        return msgspec.structs.replace(result, verdict=Verdict.UNOBSERVABLE, message=text)

    def _keep(self, action_id: UUID, device_id: UUID, sha256: str) -> bool:
        return self._pictures.keep(action_id, device_id, sha256, self._find(device_id, sha256))

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
