"""The lab that every schedule works in, and the matter in it.

host A                                   host B
bottle ──pump 0──▶ syringe 0 ──▶ flask   the same once more; one run goes from A to B
bottle ──pump 1──▶ syringe 1 ──▶ flask
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.messages.commands import ResourceView

HOSTS = ("A", "B")
DEVICE_COUNT = 2
STROKE_NL = 100_000


@cache
def id_of(kind: int, number: int = 0) -> UUID:
    """Return the id of a thing; ids are small numbers, so that traces can be read."""
    return UUID(int=kind << 64 | number)


HOST, DEVICE, BOTTLE, SYRINGE, FLASK, JOB, ACTION, JOURNAL, RUN, BENCH, BATCH = range(1, 12)


@cache
def host_id(name: str) -> UUID:
    """Return the id of a host."""
    return id_of(HOST, HOSTS.index(name) + 1)


@dataclass(frozen=True, slots=True)
class Pump:
    """A device with what it is plumbed to."""

    host: str
    number: int
    id: UUID
    bottle: UUID
    syringe: UUID
    flask: UUID


def _pump(host: str, number: int) -> Pump:
    base = HOSTS.index(host) * 16
    own = base + number + 1
    return Pump(
        host=host,
        number=number,
        id=id_of(DEVICE, own),
        bottle=id_of(BOTTLE, base + 1),
        syringe=id_of(SYRINGE, own),
        flask=id_of(FLASK, base + 1),
    )


PUMPS = {(host, number): _pump(host, number) for host in HOSTS for number in range(DEVICE_COUNT)}
OWNER = {
    vessel: pump.host
    for pump in PUMPS.values()
    for vessel in (pump.bottle, pump.syringe, pump.flask)
}
NAMES = (
    {pump.bottle: f"bottle {pump.host}" for pump in PUMPS.values()}
    | {pump.flask: f"flask {pump.host}" for pump in PUMPS.values()}
    | {pump.syringe: f"syringe {pump.host}{pump.number}" for pump in PUMPS.values()}
)


def vessels() -> list[ResourceView]:
    """Return every vessel as it stands at the beginning."""
    found = {}
    for pump in PUMPS.values():
        for vessel, kind, nl in (
            (pump.bottle, "bottle", 1_000_000),
            (pump.syringe, "syringe", 0),
            (pump.flask, "flask", 0),
        ):
            found[vessel] = ResourceView(
                id=vessel,
                name=NAMES[vessel],
                kind=kind,
                rev=1,
                contents={f"lot {pump.host}": nl} if nl else {},
                capacity_nl=2_000_000,
            )
    return list(found.values())


def stroke(pump: Pump, *, is_draw: bool) -> TransferLiquid:
    """Return one stroke of a pump."""
    source, target = (pump.bottle, pump.syringe) if is_draw else (pump.syringe, pump.flask)
    return TransferLiquid(source_id=source, target_id=target, amount_nl=STROKE_NL)


@dataclass
class Matter:
    """What is really in the vessels, and how often each action really happened.

    It lies outside the system under test: no rule reads it, only people and checks do.
    """

    nl: dict[UUID, int] = field(
        default_factory=lambda: {view.id: sum(view.contents.values()) for view in vessels()}
    )
    count: Counter[UUID] = field(default_factory=Counter)
    moved_nl: dict[UUID, int] = field(default_factory=dict)

    def pour(self, action_id: UUID, operation: TransferLiquid, moved_nl: int) -> None:
        """Let a stroke happen."""
        self.nl[operation.source_id] -= moved_nl
        self.nl[operation.target_id] += moved_nl
        self.moved_nl[action_id] = self.moved_nl.get(action_id, 0) + moved_nl
