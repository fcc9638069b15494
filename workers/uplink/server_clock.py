"""How far the server's clock is from this host's: measured with each sign of life, and kept."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.errors import LabError
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.messages.session import Pulse, Welcome
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_link.host_clocks import (
    ClockAnchor,
    Exchange,
    anchor_of,
    best_of,
    dated,
    with_anchor,
)
from workers.base.valkey_store import ValkeyStore
from workers.journal.journal import Journal

log = logging.getLogger(__name__)

ANCHORS = "anchors"
"""Name under which the journal remembers the measures."""

KEEP_S = 60.0
"""Longest time for which a measure is in memory alone: a write for each would hold up the lines."""

MOST_ASKED = 16
"""Signs of life whose answer may still come."""


class ServerClock:
    """Measures the server's clock, and says by it when events of this host happened."""

    def __init__(self, journal: Journal, store: ValkeyStore) -> None:
        """Begin with what the journal knows: a night may have gone by since."""
        self._journal = journal
        self._store = store
        self._anchors = read_anchors(journal)
        self._asked: dict[float, HostMoment] = {}
        self._kept_s = float("-inf")

    def open(self, asked_at: HostMoment, welcome: Welcome) -> None:
        """Take in what the answer to a HELLO measures.

        Args:
            asked_at: Before HELLO was sent.
            welcome: The answer, which has just come.
        """
        self._asked.clear()
        if welcome.heard_at_s is not None:
            self._kept_s = float("-inf")
            self._take(asked_at, welcome.heard_at_s, welcome.server_at_s)

    def ask(self) -> float:
        """Return what a sign of life carries, to be said back; it is sent now."""
        at = self._journal.moment()
        self._asked[at.mono_s] = at
        if len(self._asked) > MOST_ASKED:
            del self._asked[min(self._asked)]
        return at.mono_s

    def hear(self, pulse: Pulse) -> None:
        """Take in the answer to a sign of life; one that nobody waits for says nothing."""
        asked_at = self._asked.pop(pulse.asked_s, None)
        if asked_at is not None:
            self._take(asked_at, pulse.heard_at_s, pulse.told_at_s)

    def dated(self, events: Sequence[EdgeEvent]) -> list[EdgeEvent]:
        """Return events with the moment of each by the server's clock."""
        return [dated(event, self._anchors) for event in events]

    def _take(self, asked: HostMoment, heard_at_s: float, told_at_s: float) -> None:
        exchange = Exchange(
            asked=asked,
            heard_at_s=heard_at_s,
            told_at_s=told_at_s,
            got_mono_s=self._journal.moment().mono_s,
        )
        found = anchor_of(exchange)
        if found is None:
            log.warning("the server's clock was set while it answered: that measures nothing")
            return
        self._anchors = with_anchor(self._anchors, found)
        best = best_of(self._anchors, self._journal.moment())
        self._store.put_anchor(msgspec.json.encode(best or found))
        self._keep()

    def _keep(self) -> None:
        if time.monotonic() - self._kept_s < KEEP_S:
            return
        self._kept_s = time.monotonic()
        try:
            with self._journal.write(is_durable=False) as tx:
                tx.set_meta(ANCHORS, canonical(self._anchors).decode())
        except LabError as error:
            log.error("the journal does not take how late it is at the server: %s", error)


def read_anchors(journal: Journal) -> tuple[ClockAnchor, ...]:
    """Return the measures that a journal remembers."""
    text = journal.meta(ANCHORS)
    return () if text is None else msgspec.json.decode(text, type=tuple[ClockAnchor, ...])
