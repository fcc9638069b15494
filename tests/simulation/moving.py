"""Racks carried between three hosts, while messages are lost, repeated and overtaken.

A ◀──▶ B ◀──▶ C        four racks with a vial in each; a host may die between any two writes
"""

from __future__ import annotations

from random import Random
from uuid import UUID

import msgspec

from labweb.domain.errors import StateError
from labweb.domain.messages.commands import ReceiveCommand, Release, ResourceView
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.exclusive_use import resource_custody
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState, ResourceCustody
from labweb.domain.runs.host_journal.journal_rows import HeldResource
from tests.simulation.checks import require
from tests.simulation.lab import id_of
from tests.simulation.memory import BEGINNING, Disk, MemoryWrite

HOSTS = tuple(id_of(20, number) for number in (1, 2, 3))
VIALS = tuple(id_of(21, number) for number in (1, 2, 3, 4))
"""What is carried."""

PARTS = {vial: id_of(24, number) for number, vial in enumerate(VIALS)}
"""What stands in it."""

STEPS = 120


class Moving:
    """Three disks, a server, and what is on the way between them."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)
        self.count = 0
        self.disks = {host: Disk(host, id_of(22, host.int)) for host in HOSTS}
        self.read = dict.fromkeys(HOSTS, 0)
        self.known: dict[UUID, ResourceCustody] = {}
        self.commands: dict[UUID, Release | ReceiveCommand] = {}
        """Unanswered commands, by vial: rung until the host has told what became of them."""

        self.told: dict[UUID, ResourceView] = {}
        """Parts as the server knows them; older than what their first host knows."""

        self.wire: list[Release | ReceiveCommand] = []
        self.used: set[UUID] = set()
        self.looked: dict[UUID, set[int]] = {host: set() for host in HOSTS}
        self.finished = 0
        for number, vial in enumerate(VIALS):
            host = HOSTS[number % 3]
            view = ResourceView(
                id=vial, name=f"vial {number}", kind="vial", rev=1, contents={"a": 100 + number}
            )
            part = ResourceView(
                id=PARTS[vial], name="part", kind="vial", rev=1, contents={"b": 200 + number}
            )
            for one in (view, part):
                self.disks[host].resources[one.id] = HeldResource(view=one)
            self.told[part.id] = msgspec.structs.replace(part, rev=0, contents={})
            self.known[vial] = ResourceCustody(
                resource_id=vial, state=CustodyState.OWNED, owner=host
            )

    def step(self) -> None:
        """Do one of the things that may happen next."""
        kind = self.rng.random()
        if kind < 0.15:
            self.ask()
        elif kind < 0.4:
            self.ring()
        elif kind < 0.65 and self.wire:
            self.deliver()
        elif kind < 0.9:
            self.upload(self.rng.choice(HOSTS))
        elif self.wire and kind < 0.94:
            self.wire.pop(self.rng.randrange(len(self.wire)))
        elif self.wire and kind < 0.98:
            self.wire.append(self.rng.choice(self.wire))
        else:
            vial = self.rng.choice(VIALS)
            self.used ^= {self.rng.choice((vial, PARTS[vial]))}
        self.check()

    def ask(self) -> None:
        vial, target = self.rng.choice(VIALS), self.rng.choice(HOSTS)
        self.count += 1
        before = self.known[vial]
        try:
            # The server does not see every use: a host has the last word on its own.
            asked = resource_custody.ask(
                before, transfer_id=id_of(23, self.count), target=target, in_use=()
            )
        except StateError:
            return
        assert asked.transfer_id is not None
        assert before.owner is not None
        self.known[vial] = asked
        self.commands[vial] = Release(
            host_id=before.owner,
            epoch=1,
            transfer_id=asked.transfer_id,
            resource_id=vial,
            parts=[self.told[PARTS[vial]]],
        )

    def ring(self) -> None:
        self.wire += self.commands.values()

    def deliver(self) -> None:
        command = self.wire.pop(self.rng.randrange(len(self.wire)))
        disk = self.disks[command.host_id]
        dies = self.rng.random() < 0.1
        try:
            with MemoryWrite(disk, BEGINNING, lambda has_appended: None) as tx:
                if isinstance(command, Release):
                    resource_custody.take_release(tx, command, in_use=self.used)
                else:
                    resource_custody.take_receive(tx, command)
                if dies:
                    raise InterruptedError
            self.check_use(command)
        except InterruptedError:
            self.wire.append(command)

    def check_use(self, command: Release | ReceiveCommand) -> None:
        """I9: nothing leaves while an action holds it."""
        last = self.disks[command.host_id].events[-1]
        if isinstance(command, Release) and last.kind == "released":
            vial, is_fresh = command.resource_id, last.seq not in self.looked[command.host_id]
            self.looked[command.host_id].add(last.seq)
            is_used = not self.used.isdisjoint({vial, PARTS[vial]})
            require(not is_fresh or not is_used, "I9", f"{vial} left while in use")

    def upload(self, host: UUID) -> None:
        """Read the next event of a host, once and in order, as sessions see to."""
        log = self.disks[host].events
        if self.read[host] < len(log):
            event = log[self.read[host]]
            self.read[host] += 1
            self.apply(host, event)

    def apply(self, host: UUID, event: EdgeEvent) -> None:
        vial = UUID(event.body["resource_id"])
        transfer_id = UUID(event.body["transfer_id"])
        before = self.known[vial]
        self.commands.pop(vial, None)
        if event.kind == "kept":
            self.known[vial] = resource_custody.after_kept(
                before, host=host, transfer_id=transfer_id
            )
        elif event.kind == "released":
            view = msgspec.convert(event.body["view"], ResourceView)
            for part in msgspec.convert(event.body["parts"], list[ResourceView]):
                self.told[part.id] = part
            moved = resource_custody.after_released(
                before, host=host, transfer_id=transfer_id, view=view
            )
            self.known[vial] = moved
            assert moved.target is not None
            self.commands[vial] = ReceiveCommand(
                host_id=moved.target,
                epoch=1,
                transfer_id=transfer_id,
                view=view,
                parts=[self.told[PARTS[vial]]],
            )
        else:
            self.known[vial] = resource_custody.after_received(
                before, host=host, transfer_id=transfer_id
            )
            self.finished += 1

    def holders(self, vial: UUID) -> list[UUID]:
        return [host for host, disk in self.disks.items() if vial in disk.resources]

    def check(self) -> None:
        """I11: a vial is in one pair of hands, or on its way and the server knows it."""
        for vial in VIALS:
            holders, known = self.holders(vial), self.known[vial]
            require(len(holders) <= 1, "I11", f"{vial} is in {len(holders)} trees")
            on_its_way = known.state is not CustodyState.OWNED
            require(self.holders(PARTS[vial]) == holders, "I11", f"{vial} left its part behind")
            require(holders or on_its_way, "I11", f"{vial} is nowhere")
            if holders and known.state is CustodyState.OWNED:
                require(holders == [known.owner], "I11", f"{vial} has two owners")

    def drain(self) -> None:
        """Let everything arrive; then every vial has an owner, and holds what it held."""
        self.used.clear()
        for _ in range(60):
            self.ring()
            while self.wire:
                self.deliver()
            for host in HOSTS:
                for _ in range(4):
                    self.upload(host)
            self.check()
        for number, vial in enumerate(VIALS):
            known = self.known[vial]
            require(known.state is CustodyState.OWNED, "I8", f"{vial} is {known.state.value}")
            (host,) = self.holders(vial)
            require(known.owner == host, "I12", f"{vial} is elsewhere")
            contents = self.disks[host].resources[vial].view.contents
            require(contents == {"a": 100 + number}, "I12", f"{vial} holds {contents}")
            inside = self.disks[host].resources[PARTS[vial]].view.contents
            require(inside == {"b": 200 + number}, "I12", f"what is in {vial} holds {inside}")


def play(seed: int) -> int:
    """Play one schedule; return how many moves came to their end.

    Raises:
        ViolationError: A vial is in two trees, in none, or lost on its way.
    """
    world = Moving(seed)
    for _ in range(STEPS):
        world.step()
    world.drain()
    return world.finished
