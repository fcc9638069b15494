"""What a file of events carries: import, events, what hosts told, and rows they speak of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from django.apps import apps
from django.core.serializers.python import Serializer
from django.db.models import QuerySet

from labweb.crutd.selectors import Transaction
from labweb.crutd.selectors.event_chain import events_in_order, first_broken_event
from labweb.crutd.selectors.history_replay import base_document
from labweb.domain.errors import ReconcileError, StateError
from labweb.resources.selectors import Lab
from labweb.runs.selectors import HostEvent

_CHUNK = 2000
_UNDER_WAY = ("validated", "locked", "executing", "confirming")

_BEFORE = {
    "accounts.user": ("username", "first_name", "last_name"),
    "resources.lab": None,
}
"""Tables that the import and the events speak of, and their columns; None: all of them."""

_AFTER = {
    "crutd.resourcelock": None,
    "enrollment.driverversion": None,
    "enrollment.edgehost": (
        "lab", "key", "name", "journal_id", "acked_seq", "hash_at_acked", "acked_happened_s",
        "acked_uncertainty_s", "epoch", "floor",
        "last_dseq", "epoch_seen", "boots", "stop_acknowledged", "stop_acknowledged_at",
    ),
    "enrollment.device": None,
    "workflows.workflow": None,
    "workflows.workflowversion": None,
    "runs.run": None,
    "runs.job": None,
    "runs.attempt": None,
}  # fmt: skip
"""Tables of the runs: what the events of hosts speak of."""

TABLES = {**_BEFORE, **_AFTER}
"""No password, no key of a host and no role is among the columns."""


def check_exportable(lab: Lab) -> None:
    """See to it that the events tell all that is in the rows.

    Raises:
        StateError: A transaction is under way, of which no event tells yet.
        ReconcileError: The chain of events is broken, or nothing was kept of the import.
    """
    if Transaction.objects.filter(lab=lab, state__in=_UNDER_WAY).exists():
        raise StateError(
            "a transaction is under way: pause the runs and wait for it", code="rebuild.under_way"
        )
    broken = first_broken_event(lab)
    if broken is not None:
        raise ReconcileError(broken.message, code="rebuild.chain", context=broken.context)
    base_document(lab)


def records_of(lab: Lab) -> Iterator[tuple[str, Any]]:
    """Yield kind and body of all that a lab is rebuilt from, in an order that stays the same."""
    yield from _rows(_BEFORE)
    document, sha256 = base_document(lab)
    yield "import", {"lab_id": lab.id, "document": document.decode(), "sha256": sha256}
    for event in events_in_order(lab):
        yield (
            "event",
            {
                "seq": event.seq,
                "at": event.at.isoformat(),
                "transaction_id": event.transaction_id,
                "body": event.body,
                "prev_hash": event.prev_hash,
                "hash": event.hash,
            },
        )
    yield from _rows(_AFTER)
    told = HostEvent.objects.filter(host__lab=lab).order_by("id")
    for row in told.iterator(chunk_size=_CHUNK):
        yield (
            "host_event",
            {
                "host_id": row.host_id,
                "journal_id": row.journal_id,
                "seq": row.seq,
                "kind": row.kind,
                "action_id": row.action_id,
                "at_s": row.at_s,
                **clock_of(row),
                "received_at": row.received_at.isoformat(),
                "body": row.body,
                "hash": row.hash,
            },
        )


def clock_of(row: HostEvent) -> dict[str, Any]:
    """Return what is known of when an event happened; nothing of one from an older program."""
    if row.happened_at is None:
        return {}
    return {
        "mono_s": row.mono_s,
        "boot_id": row.boot_id,
        "happened_at": row.happened_at.isoformat(),
        "uncertainty_s": row.uncertainty_s,
        "is_bounded": row.is_bounded,
    }


def _rows(tables: Mapping[str, tuple[str, ...] | None]) -> Iterator[tuple[str, Any]]:
    for label, columns in tables.items():
        rows: QuerySet[Any] = apps.get_model(label)._default_manager.order_by("pk")  # noqa: SLF001 - the public name
        if label == "crutd.resourcelock":
            rows = rows.filter(released_at__isnull=True)
        for row in rows.iterator(chunk_size=_CHUNK):
            [plain] = Serializer().serialize([row], fields=columns)
            yield "row", plain
