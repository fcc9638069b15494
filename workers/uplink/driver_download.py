"""Fetch the source of drivers from the server: by digest, piece by piece, checked when whole."""

from __future__ import annotations

from labweb.domain.enrollment.driver_bundle import MAX_BUNDLE_BYTES
from labweb.domain.errors import ConformanceError, LabError
from labweb.domain.messages.devices_and_drivers import DeviceConfig, DriverPart, Signed
from workers.journal.journal import Journal
from workers.line.driver_reports import tell_refused
from workers.line.driver_store import DriverStore, is_installed


class DriverDownload:
    """Gathers bundles piece by piece from the uplink."""

    def __init__(self, journal: Journal, store: DriverStore) -> None:
        self._journal = journal
        self._store = store
        self._pieces: dict[str, list[bytes]] = {}
        self._approvals: dict[str, Signed] = {}

    def missing(self) -> list[str]:
        """Return the digests that devices need and that are not here, and forget half a bundle."""
        self._pieces.clear()
        wanted = [*self._journal.devices(), *self._journal.staged()]
        found = {
            one.digest
            for one in wanted
            if not is_installed(one.module, one.digest) and not self._store.has(one.digest)
        }
        return sorted(found)

    def take(self, part: DriverPart) -> None:
        """Take one piece; with the last one, check the whole and keep it.

        What is not what was approved is not kept, and the server is told.
        """
        try:
            self._take(part)
        except LabError as error:
            self._refuse(part.digest, error)
        except OSError as error:
            self._refuse(part.digest, ConformanceError(str(error), code="driver.store"))

    def _refuse(self, digest: str, error: LabError) -> None:
        self._pieces.pop(digest, None)
        tell_refused(self._journal, self._waiting_for(digest), error.code, error.message)

    def _take(self, part: DriverPart) -> None:
        if part.problem:
            raise ConformanceError(f"the server gives no source: {part.problem}")
        pieces = self._pieces.setdefault(part.digest, [])
        if part.index == 0:
            pieces.clear()
            if part.approval is None:
                raise ConformanceError("the source came unapproved", code="driver.unsigned")
            self._approvals[part.digest] = part.approval
        if part.index != len(pieces):
            raise ConformanceError("a piece of the source is missing", code="driver.bundle")
        pieces.append(part.data)
        if sum(map(len, pieces)) > MAX_BUNDLE_BYTES:
            raise ConformanceError("the source is larger than any", code="driver.bundle")
        if len(pieces) == part.count:
            data = b"".join(self._pieces.pop(part.digest))
            approval = self._approvals.pop(part.digest)
            self._store.keep(part.digest, data, approval, self._journal.command_keys())

    def _waiting_for(self, digest: str) -> list[DeviceConfig]:
        wanted = [*self._journal.devices(), *self._journal.staged()]
        return [one for one in wanted if one.digest == digest]
