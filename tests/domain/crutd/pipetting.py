"""A small bench that carries out what the rules let through, and keeps its record by them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from uuid import UUID, uuid5

from labweb.domain.crutd.operations import Operation
from labweb.domain.crutd.pipette_tips import find_tip
from labweb.domain.crutd.settlement import Outcome, OutcomeKind, ResourceState, settle
from labweb.domain.resources.contents_by_lot import LotId, add, remove, total_nl
from labweb.domain.resources.resource import Resource

CHANNEL = uuid5(UUID(int=0), "channel")


def state_of(row: Resource) -> ResourceState:
    """What a decision needs to know of a new row."""
    capacity = row.config.get("capacity_ul")
    return ResourceState(
        id=row.id,
        name=row.key,
        kind=row.kind,
        parent_id=row.parent_id,
        capacity_nl=None if capacity is None else round(capacity * 1000),
    )


@dataclass
class Record:
    """States by id; only a settled change alters them."""

    states: dict[UUID, ResourceState] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: Iterable[Resource]) -> Record:
        """The rows of a lab and one pipette channel."""
        states = {row.id: state_of(row) for row in rows}
        states[CHANNEL] = ResourceState(id=CHANNEL, name="channel", kind="pipette_channel")
        return cls(states)

    def fill(self, vessel: UUID, amount_nl: int) -> None:
        """Say what stands in a vessel; every vessel has a lot of its own."""
        contents = {LotId(str(vessel)): amount_nl} if amount_nl else {}
        self.states[vessel] = replace(self.states[vessel], contents=contents)

    def carry_out(self, operation: Operation) -> None:
        """Do an operation as asked, and write down what is settled."""
        change = settle(operation, self.states, Outcome(kind=OutcomeKind.DONE))
        for posting in change.postings:
            parts = {posting.lot: posting.amount_nl}
            source, target = UUID(posting.debit), UUID(posting.credit)
            self._set(source, remove(self.states[source].contents, parts))
            self._set(target, add(self.states[target].contents, parts))
        for moved, to in change.moves.items():
            self.states[moved] = replace(self.states[moved], parent_id=to)

    def _set(self, vessel: UUID, contents: dict[LotId, int]) -> None:
        self.states[vessel] = replace(self.states[vessel], contents=contents)

    def held_nl(self, vessel: UUID) -> int:
        """Return what stands in a vessel."""
        return total_nl(self.states[vessel].contents)

    def total_nl(self) -> int:
        """Return all the liquid there is."""
        return sum(total_nl(state.contents) for state in self.states.values())

    @property
    def tip(self) -> ResourceState | None:
        """The tip on the channel."""
        return find_tip(CHANNEL, self.states)
