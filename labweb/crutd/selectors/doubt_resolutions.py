"""How transactions that were in doubt were resolved: events are appended, and read together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from uuid import UUID

from labweb.accounts import selectors as account_selectors
from labweb.crutd.answers import DoubtEnd
from labweb.crutd.models import Event
from labweb.domain.crutd.resolution_words import resolution_words
from labweb.domain.crutd.transaction_states import TransactionState


@dataclass(frozen=True, slots=True, kw_only=True)
class Resolved:
    """The end of a doubt."""

    doubt_at: datetime
    at: datetime
    state: str
    """Of the transaction since then."""

    by: str
    """Name of the person who answered; empty: nobody is known."""

    resolution: Mapping[str, Any]

    def told(self) -> DoubtEnd:
        """Say it, with a sentence for people."""
        return DoubtEnd(
            doubt_at=self.doubt_at,
            at=self.at,
            state=TransactionState(self.state),
            by=self.by,
            answer=self.resolution.get("answer") or "",
            moved_nl=self.resolution.get("moved_nl"),
            note=self.resolution.get("note") or "",
            despite_reading=self.resolution.get("despite_reading") or "",
            text=resolution_words(self.resolution, self.state, self.by),
        )


def resolved_of(transaction_ids: Iterable[UUID]) -> dict[UUID, Resolved]:
    """Return how each transaction that was in doubt was resolved; two queries.

    One that never was in doubt, or still is, is left out.
    """
    ids = list(transaction_ids)
    if not ids:
        return {}
    rows = Event.objects.filter(transaction__in=ids).order_by("seq")
    doubts: dict[UUID, datetime] = {}
    ends: dict[UUID, tuple[datetime, str, Mapping[str, Any]]] = {}
    for about, at, state, body in rows.values_list("transaction_id", "at", "state", "body"):
        if state == TransactionState.QUARANTINED.value:
            doubts[about] = at
        elif about in doubts:
            ends[about] = (at, state, body.get("resolution") or {})
    people = {str(told["by_id"]) for _, _, told in ends.values() if told.get("by_id")}
    names = account_selectors.printed_names(people) if people else {}
    return {
        about: Resolved(
            doubt_at=doubts[about],
            at=at,
            state=state,
            by=names.get(str(told.get("by_id")), ""),
            resolution=told,
        )
        for about, (at, state, told) in ends.items()
    }


def ends_of_doubts(events: Iterable[Event]) -> dict[int, DoubtEnd]:
    """Return, by the id of an event that left a doubt, how that ended; none while it lasts."""
    doubts = [one for one in events if one.state == TransactionState.QUARANTINED.value]
    found = resolved_of(one.transaction_id for one in doubts)
    return {
        one.id: found[one.transaction_id].told() for one in doubts if one.transaction_id in found
    }
