"""The lab at the end of one transaction: where things stood, what they held, whence it came."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from uuid import UUID

from labweb.crutd.models import Event
from labweb.crutd.selectors import lineage
from labweb.crutd.selectors.history_replay import replayed_to
from labweb.domain.crutd.event_replay import Replay
from labweb.domain.crutd.ledger import Amount
from labweb.domain.crutd.provenance.ledger_flows import is_nominal
from labweb.domain.crutd.provenance.lineage import Limits, Page, trace_up
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.resources.selectors import Lab

_DEPTH = 100
_SIZE = 10_000


@dataclass(frozen=True, slots=True)
class LabMoment:
    """A lab just after an event."""

    lab: Lab
    at: datetime
    replay: Replay

    def vessels_in(self, ids: Collection[UUID]) -> list[UUID]:
        """Return those of the resources, and of what stood in them, that hold matter; by key."""
        nodes = self.replay.nodes
        below: dict[UUID | None, list[UUID]] = {}
        for node in nodes.values():
            below.setdefault(node.parent_id, []).append(node.id)
        found, left = set(), [i for i in ids if i in nodes]
        while left:
            one = left.pop()
            if one not in found:
                found.add(one)
                left += below.get(one, [])
        vessels = [i for i in found if is_vessel(nodes[i].kind)]
        return sorted(vessels, key=lambda i: nodes[i].key)

    def held(self, vessel: UUID) -> dict[LotId, Amount]:
        """Return what a vessel held, by lot."""
        return {lot: amount for lot, amount in self.replay.contents(vessel).items() if amount}

    def came_through(self, vessel: UUID) -> tuple[list[UUID], bool]:
        """Return the vessels that its contents had come from, and whether these are all."""
        trace = trace_up(str(vessel), self._history, Limits(depth=_DEPTH, size=_SIZE))
        names = {name for flow in trace.flows for name in (flow.source, flow.target)}
        found = {UUID(name) for name in names if not is_nominal(name)} - {vessel}
        return sorted(found), trace.is_whole

    def _history(self, accounts: Collection[str]) -> Page:
        page = lineage.history(accounts)
        kept = [flow for flow in page.flows if datetime.fromisoformat(flow.at) <= self.at]
        return Page(kept, page.unread)


def moment_after(lab: Lab, transaction_id: UUID) -> LabMoment | None:
    """Return the lab just after the last event of a transaction; None when it has none.

    Raises:
        ReconcileError: The import or an event cannot be read.
    """
    event = Event.objects.filter(transaction_id=transaction_id).order_by("-seq").first()
    if event is None:
        return None
    replay = replayed_to(lab, event.at, event.seq)
    return None if replay is None else LabMoment(lab, event.at, replay)


def lots_told(moment: LabMoment, vessels: Collection[UUID], lots: dict[str, Any]) -> Iterator[Any]:
    """Yield what vessels held, lot by lot, as plain data."""
    for vessel in vessels:
        for lot_id, amount in sorted(moment.held(vessel).items()):
            lot = lots[lot_id]
            yield {
                "vessel": moment.replay.nodes[vessel].key,
                "lot": lot.key,
                "material": lot.material.name,
                "inchikey": lot.material.inchikey,
                "supplier": lot.supplier,
                "number": lot.number,
                "amount": amount.nl or amount.ug,
                "amount_unit": "nL" if amount.nl else "ug",
            }
