"""A lab's events in a file: written here, and a lab made of them in another, empty database."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from itertools import groupby
from pathlib import Path
from typing import Any
from uuid import UUID

import msgspec
from django.core.exceptions import ValidationError
from django.core.serializers.base import DeserializationError
from django.core.serializers.python import Deserializer
from django.db import DatabaseError
from django.db.transaction import atomic

from labweb.accounts.selectors import User
from labweb.common.database.reading import one_moment
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors import Event
from labweb.crutd.selectors.event_chain import broken_link, told_columns
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.domain.crutd import operations
from labweb.domain.errors import DefinitionError, ReconcileError, StateError
from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.domain.runs.states import event_export_file
from labweb.domain.runs.states.event_export_file import ExportLine, bad_line
from labweb.records.selectors.event_file import TABLES, check_exportable, records_of
from labweb.records.services.ledger_rebuild import differences
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs.selectors import HostEvent
from labweb.runs.services.fault_recovery.job_states_from_events import write_job_states

_CHUNK = 2000
_ORDER = ("row", "import", "event", "row", "host_event")


def export(lab: Lab, out: Path) -> int:
    """Write the events of a lab, and what they speak of, to a file; return its lines.

    All of it is of one moment, whatever is written meanwhile. The file is whole or not there.

    Raises:
        StateError: A transaction is under way.
        ReconcileError: A chain of events is broken.
        OSError: The file cannot be written.
    """
    half = out.with_name(out.name + ".part")
    count = 0
    try:
        with one_moment(), half.open("wb") as file:
            check_exportable(lab)
            for line in event_export_file.write(records_of(lab)):
                file.write(line)
                count += 1
        for _ in _things(half):
            pass  # what was written is read again, with both chains, before it counts
        half.replace(out)
    finally:
        half.unlink(missing_ok=True)
    return count


def restore(path: Path) -> Lab:
    """Make a lab of a file of events, in a database that has tables and no lab.

    The file is read to its end before the first row is written. Nobody can sign in with what
    it brings, and no host is admitted by it: it carries no password, no role and no key.

    Raises:
        StateError: `rebuild.not_empty`: there is a lab or a user.
        DefinitionError: `event_file.line`: the first line that does not hold. Nothing was
            written.
        ReconcileError: The events do not tell one lab. Nothing was written.
        OSError: The file cannot be read.

    Effect:
        None on matter.
    """
    for _ in _things(path):
        pass
    try:
        with atomic():
            lab = _write(path)
    except DatabaseError as error:
        raise ReconcileError(
            f"the events break a rule of the record: {error}", code="rebuild.unreadable"
        ) from error
    return lab


def _write(path: Path) -> Lab:
    if resource_selectors.labs().exists() or User.objects.exists():
        raise StateError(
            "this database holds a lab or a user already: give an empty one, with its tables",
            code="rebuild.not_empty",
        )
    document = b""
    lab: Lab | None = None
    for kind, things in groupby(_things(path), key=lambda thing: thing.kind):
        rows = (thing.row for thing in things)
        if kind == "row":
            for row in rows:
                row.save()
        elif kind == "import":
            base = next(rows)
            document, lab = base["document"].encode(), Lab.objects.get(pk=base["lab_id"])
        elif kind == "event" and lab is not None:
            crutd_services.restore(lab, document, rows)
        else:
            _keep(rows)
    if lab is None:
        raise ReconcileError("the file holds no lab", code="rebuild.no_base")
    write_job_states(lab)
    left = [*differences(lab), *ledger_violations(lab)]
    if left:
        raise ReconcileError(left[0].message, code="rebuild.stray", findings=left)
    return lab


def _keep(rows: Iterable[HostEvent]) -> None:
    HostEvent.objects.bulk_create(rows, batch_size=_CHUNK)


@dataclass(frozen=True, slots=True)
class _Thing:
    """What a line stands for; nothing is written yet."""

    kind: str
    row: Any


@dataclass(slots=True)
class _Reader:
    """Turns lines into rows, and knows where each chain stands."""

    place: int = 0
    seq: int = 0
    prev: str = ""
    heads: dict[tuple[UUID, UUID], tuple[int, str]] = field(default_factory=dict)
    sha256: str = ""
    lab_id: UUID | None = None

    def thing(self, line: ExportLine) -> _Thing:
        """Read one line.

        Raises:
            DefinitionError: It does not stand where it may, or does not fit the ones before it.
        """
        while self.place < len(_ORDER) and _ORDER[self.place] != line.kind:
            self.place += 1
        if self.place == len(_ORDER):
            raise bad_line(line.n, f"is of the kind {line.kind!r}, which has no place there")
        read = {
            "row": self._row,
            "import": self._import,
            "event": self._event,
            "host_event": self._host_event,
        }[line.kind]
        try:
            return _Thing(line.kind, read(line.n, line.body))
        except (
            DeserializationError, ValidationError, msgspec.ValidationError,
            KeyError, TypeError, ValueError, AttributeError,
        ) as error:  # fmt: skip
            raise bad_line(line.n, f"cannot be read as {line.kind}: {error}") from error

    def _row(self, n: int, body: Any) -> Any:  # noqa: ANN401 - what a line says
        columns = TABLES.get(body["model"], ())
        if columns == () or (columns is not None and not set(body["fields"]) <= set(columns)):
            raise bad_line(n, f"names a table or a column that no such file has: {body['model']}")
        [found] = Deserializer([body])
        if isinstance(found.object, User):
            found.object.set_unusable_password()
            found.object.is_active = False
        return found

    def _import(self, n: int, body: Any) -> Any:  # noqa: ANN401
        if hashlib.sha256(body["document"].encode()).hexdigest() != body["sha256"]:
            raise bad_line(n, "holds an import that does not fit its digest")
        self.sha256, self.lab_id = body["sha256"], UUID(body["lab_id"])
        return {"lab_id": self.lab_id, "document": body["document"]}

    def _event(self, n: int, body: Any) -> Event:  # noqa: ANN401
        if self.lab_id is None:
            raise bad_line(n, "is an event before the import")
        operation = operations.from_json(body["body"]["operation"])
        event = Event(
            lab_id=self.lab_id,
            seq=body["seq"],
            at=datetime.fromisoformat(body["at"]),
            **told_columns(body["body"]),
            transaction_id=UUID(body["transaction_id"]),
            name=operations.name_of(operation).value,
            state=body["body"]["change"]["state"],
            body=body["body"],
            prev_hash=body["prev_hash"],
            hash=body["hash"],
        )
        broken = broken_link(event, self.seq + 1, self.prev)
        if broken is not None:
            raise bad_line(n, f"breaks the chain of events: {broken.message}")
        if event.seq == 1 and body["body"].get("base") != self.sha256:
            raise bad_line(n, "does not name the import that the events are replayed on")
        self.seq, self.prev = event.seq, event.hash
        return event

    def _host_event(self, n: int, body: Any) -> HostEvent:  # noqa: ANN401
        journal = (UUID(body["host_id"]), UUID(body["journal_id"]))
        action_id = None if body["action_id"] is None else UUID(body["action_id"])
        seq, prev = self.heads.get(journal, (0, ""))
        told = EdgeEvent(
            seq=body["seq"], prev_hash=prev, hash=body["hash"], kind=body["kind"],
            action_id=action_id, at_s=body["at_s"], body=body["body"],
            mono_s=body.get("mono_s"), boot_id=body.get("boot_id", ""),
        )  # fmt: skip
        if told.seq != seq + 1 or event_hash(journal[1], prev, told) != told.hash:
            raise bad_line(n, f"breaks the chain of host {journal[0]} at its event {told.seq}")
        self.heads[journal] = (told.seq, told.hash)
        happened = body.get("happened_at")
        return HostEvent(
            host_id=journal[0],
            journal_id=journal[1],
            seq=told.seq,
            hash=told.hash,
            kind=told.kind,
            action_id=action_id,
            at_s=told.at_s,
            mono_s=told.mono_s,
            boot_id=told.boot_id,
            happened_at=None if happened is None else datetime.fromisoformat(happened),
            uncertainty_s=body.get("uncertainty_s"),
            is_bounded=body.get("is_bounded", False),
            received_at=datetime.fromisoformat(body["received_at"]),
            body=told.body,
        )


def _things(path: Path) -> Iterator[_Thing]:
    """Yield what the lines stand for.

    Raises:
        DefinitionError: The first line that does not hold.
    """
    reader = _Reader()
    with path.open("rb") as file:
        for line in event_export_file.read(file):
            yield reader.thing(line)
    if not reader.seq:
        raise DefinitionError("the file holds no event", code="event_file.line")
