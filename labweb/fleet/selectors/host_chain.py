"""Do the events that hosts have told still stand as they were told? The first that does not."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.enrollment.selectors import EdgeHost
from labweb.runs.selectors.events_of_hosts import HostEvent, events_of_host

_AT_ONCE = 2000


def first_broken_host_event(host: EdgeHost) -> Finding | None:
    """Return the first event of a host that was edited, removed or moved; None: all stand.

    Each journal of the host has a chain of its own from its event 1 on. Of the journal that the
    host keeps now, the last event is the one that the server has acknowledged.
    """
    rows = events_of_host(host)
    journal: UUID | None = None
    seq, head = 0, ""
    ends: dict[UUID, tuple[int, str]] = {}
    for row in rows.iterator(chunk_size=_AT_ONCE):
        if row.journal_id != journal:
            journal, seq, head = row.journal_id, 0, ""
        if row.seq != seq + 1:
            text = f"event {seq + 1} of {host.name} is missing"
            return Finding("host_events.missing", text, str(host.id))
        if event_hash(row.journal_id, head, _told(row, head)) != row.hash:
            text = f"event {row.seq} of {host.name} was edited (row {row.id})"
            return Finding("host_events.edited", text, str(host.id))
        seq, head = row.seq, row.hash
        ends[row.journal_id] = (seq, head)
    if host.journal_id is None:
        return None
    seq, head = ends.get(host.journal_id, (0, ""))
    if (seq, head) != (host.acked_seq, host.hash_at_acked):
        text = f"event {seq} of {host.name} is the last one, and {host.acked_seq} were acknowledged"
        return Finding("host_events.truncated", text, str(host.id))
    return None


def _told(row: HostEvent, prev: str) -> EdgeEvent:
    return EdgeEvent(
        seq=row.seq,
        prev_hash=prev,
        hash=row.hash,
        kind=row.kind,
        action_id=row.action_id,
        at_s=row.at_s,
        body=row.body,
        mono_s=row.mono_s,
        boot_id=row.boot_id,
    )
