"""A host with the real rules over a journal in memory, against the real server."""

from __future__ import annotations

import msgspec

from labweb.crutd.models import ResourceLock
from labweb.domain.messages import Command, Signed, Welcome
from labweb.domain.runs import acting, edge, relay, standing, taking
from labweb.domain.runs.acting import Scene, Started
from labweb.domain.runs.edge import ActionState, Report
from labweb.domain.runs.moment import Moment
from labweb.runs import services
from labweb.runs.models import Job, Outbox, Run
from tests.builders import Bench, Edge
from tests.simulation.memory import Disk, MemoryWrite


class Host:
    """A host with the real rules over a journal in memory."""

    def __init__(self, bench: Bench) -> None:
        self.edge = Edge(bench)
        self.disk = Disk(self.edge.host_id, self.edge.journal_id)
        self.mono_s = 1.0
        self.wall_s = 1_800_000_000.0
        self.told = 0
        self.reconnect()

    def reconnect(self) -> None:
        """Open a session, with what the journal says, and be resumed."""
        self.edge.events = list(self.disk.events)
        self.edge.connect()
        welcome = Welcome(
            epoch=self.edge.epoch, acked_seq=0, floor=0, server_at_s=0.0, mode="normal"
        )
        with self.write() as tx:
            standing.write_welcome(tx, welcome)
        with self.write() as tx:
            standing.write_armed(tx, "boot", None)

    def write(self) -> MemoryWrite:
        return MemoryWrite(self.disk, self.wall_s, lambda has_appended: None)

    def now(self) -> Moment:
        return Moment(boot_id="boot", mono_s=self.mono_s, wall_s=self.wall_s)

    def take(self) -> None:
        """Take every batch and cancel that waits in the outbox."""
        for row in Outbox.objects.filter(settled_at__isnull=True).order_by("id"):
            signed, command = as_sent(row, self.edge.epoch)
            with self.write() as tx:
                taking.take_command(
                    tx, signed, command, at=self.now(), line_of=lambda device_id: "line"
                )

    def step(self, *, report: Report | None = None) -> bool:
        """Carry out the next action that may start; False: none may."""
        for row in self.disk.rows(ActionState.ACCEPTED):
            with self.write() as tx:
                found = acting.start(
                    tx, row, row.do, at=self.now(), scene=Scene(pid=1, driver_digest="d")
                )
            if isinstance(found, Started):
                amount = row.do.operation.get("amount_nl")
                done = report or Report(ok=True, moved_nl=amount)
                with self.write() as tx:
                    acting.write_end(tx, row, done, [])
                return True
            if found.kind == edge.REJECT:
                return True
        return False

    def tell(self) -> None:
        """Send what the server has not read."""
        fresh = self.disk.events[self.told :]
        assert services.ingest_events(self.edge.host_id, self.edge.epoch, fresh) is not None
        self.told = len(self.disk.events)


def as_sent(row: Outbox, epoch: int) -> tuple[Signed, Command]:
    """Return a command of the outbox as it travels."""

    def sign(command: Command) -> Signed:
        body = msgspec.json.encode(command).decode()
        return Signed(body=body, key_id="k", signature="")

    if row.kind == "batch":
        draft = msgspec.convert(row.body, relay.BatchDraft)
        command: Command = relay.signed_batch(draft, epoch, sign)
    else:
        command = relay.stamped(msgspec.convert(row.body, Command), epoch)
    return sign(command), command


def states(run: Run) -> list[str]:
    """Return where the jobs of a run stand, in order."""
    return list(Job.objects.filter(run=run).order_by("index").values_list("state", flat=True))


def live_locks() -> int:
    """Count the locks that hold."""
    return ResourceLock.objects.filter(released_at__isnull=True).count()
