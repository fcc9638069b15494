"""A host with the real rules over a journal in memory, against the real server."""

from __future__ import annotations

from datetime import timedelta
from typing import Any
from uuid import UUID

import msgspec

from labweb.approvals.models import ApprovalRequest
from labweb.common.clock import now
from labweb.crutd.models import ResourceLock
from labweb.domain.crutd.pre_and_postconditions import (
    Condition,
    ConditionResult,
    Readings,
    evaluate,
)
from labweb.domain.messages.commands import Command, Tick
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.session import Welcome
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.dispatch import command_outbox
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.host_actions import action_execution, command_acceptance, host_state
from labweb.domain.runs.host_actions.action_execution import HostScene, Started
from labweb.domain.runs.host_journal import action_states as edge
from labweb.domain.runs.host_journal.action_states import ActionReport, ActionState
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from labweb.domain.runs.host_journal.paired_actions import partner_of
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import host_events
from labweb.runs import services
from labweb.runs.models import Job, Outbox, Run
from tests.builders import Bench, Edge, a_started_run
from tests.labweb.web import signed_in
from tests.simulation.memory import Disk, MemoryWrite


class Host:
    """A host with the real rules over a journal in memory."""

    def __init__(self, bench: Bench, edge: Edge | None = None) -> None:
        self.edge = edge or Edge(bench)
        self.disk = Disk(self.edge.host_id, self.edge.journal_id)
        self.mono_s = 1.0
        self.wall_s = 1_800_000_000.0
        self.told = 0
        self.late_s = 0.0
        self.waited_s = 0.0
        """For how long a command has lain in the broker when it is taken."""

        self.server_clock = "server-boot"
        self.reconnect()

    def reconnect(self) -> None:
        """Open a session, with what the journal says, and be resumed."""
        self.edge.events = list(self.disk.events)
        self.edge.connect()
        served = enrollment_services.devices_of(self.edge.host_id, self.edge.epoch)
        assert served is not None
        welcome = Welcome(
            epoch=self.edge.epoch,
            acked_seq=0,
            floor=0,
            server_at_s=0.0,
            mode="normal",
            tick=self.tick(),
            devices=served.devices,
        )
        with self.write() as tx:
            host_state.write_welcome(tx, welcome)
            host_state.write_server_clock(tx, welcome.tick, self.now())
        with self.write() as tx:
            host_state.write_armed(tx, "boot", None)

    def write(self) -> MemoryWrite:
        return MemoryWrite(self.disk, self.now(), lambda has_appended: None)

    def tick(self) -> Tick:
        """Return the moment by the server's clock, which is far from the host's own."""
        return Tick(clock=self.server_clock, at_s=self.mono_s + 5_000_000.0)

    def now(self) -> HostMoment:
        return HostMoment(boot_id="boot", mono_s=self.mono_s, wall_s=self.wall_s)

    def take(self) -> None:
        """Take every command for this host that waits in the outbox."""
        rows = Outbox.objects.filter(host_id=self.edge.host_id, settled_at__isnull=True)
        for row in rows.order_by("id"):
            sent = self.tick()
            sent = msgspec.structs.replace(sent, at_s=sent.at_s - self.waited_s)
            signed, command = as_sent(row, self.edge.epoch, late_s=self.late_s, sent=sent)
            with self.write() as tx:
                command_acceptance.take_command(
                    tx, signed, command, at=self.now(), line_of=lambda device_id: "line"
                )

    def step(
        self,
        *,
        report: ActionReport | None = None,
        before: Readings | None = None,
        after: Readings | None = None,
    ) -> bool:
        """Carry out the next action that may start; False: none may.

        Conditions are judged only on the readings that are given, before and after the act.
        """
        rows = self.disk.rows(ActionState.ACCEPTED)
        # Of two that meet, the second has to be ready before the first may start both.
        for row in (*rows, *(one for one in rows if partner_of(one.do))):
            with self.write() as tx:
                scene = HostScene(pid=1, driver_digest="d", judged=judged(row.do.pre, before))
                start = (
                    action_execution.start
                    if partner_of(row.do) is None
                    else action_execution.start_both
                )
                found = start(tx, row, row.do, at=self.now(), scene=scene)
            if isinstance(found, Started):
                amount = row.do.operation.get("amount_nl")
                done = report or ActionReport(ok=True, moved_nl=amount)
                self._receive(row)
                with self.write() as tx:
                    action_execution.write_end(tx, row, done, judged(row.do.post, after))
                return True
            if found.kind == edge.REJECT:
                return True
        return False

    def _receive(self, giver: ActionRow) -> None:
        """End well what has begun together with an action, if anything has."""
        partner_id = partner_of(giver.do)
        if partner_id is None:
            return
        with self.write() as tx:
            row = tx.action(partner_id)
            assert row is not None
            action_execution.write_end(tx, row, ActionReport(ok=True), [])

    def begin(self) -> ActionRow:
        """Start the next action that may, and leave it under way."""
        row = self.disk.rows(ActionState.ACCEPTED)[0]
        scene = HostScene(pid=1, driver_digest="d")
        with self.write() as tx:
            assert isinstance(
                action_execution.start(tx, row, row.do, at=self.now(), scene=scene), Started
            )
        return row

    def end(self, row: ActionRow, report: ActionReport, *, is_halted: bool = False) -> None:
        """End an action that is under way."""
        if is_halted:
            with self.write() as tx:
                halted_setpoints.write_halt(tx, row, halted_setpoints.WITH_ACTION)
        with self.write() as tx:
            action_execution.write_end(tx, row, report, [])

    def stop(self, stop_id: UUID) -> None:
        """Take the word that the lab is stopped."""
        with self.write() as tx:
            host_state.write_stop(tx, StopLabFrame(stop_id=stop_id, issued_by="ada"))

    def halt_owed(self) -> None:
        """Halt what is owed a halt, as the processes of the lines do once a device answers."""
        for device_id in sorted(self.disk.host_state("").owes_halt):
            with self.write() as tx:
                halted_setpoints.write_late_halt(
                    tx, UUID(device_id), "its device was halted, and stands", {}
                )

    def tell(self) -> None:
        """Send what the server has not read."""
        fresh = self.disk.events[self.told :]
        assert host_events.ingest_events(self.edge.host_id, self.edge.epoch, fresh) is not None
        self.told = len(self.disk.events)


def hear_stop(bench: Bench, host: Host) -> None:
    """Have the host take the word of the stop that is latched."""
    bench.lab.refresh_from_db()
    assert bench.lab.stop_id is not None
    host.stop(bench.lab.stop_id)


def judged(
    conditions: list[dict[str, Any]], readings: Readings | None
) -> list[tuple[Condition, ConditionResult]]:
    """Judge conditions as they came in a command; None: nobody judges them."""
    if readings is None:
        return []
    known = msgspec.convert(conditions, list[Condition])
    return [(one, evaluate(one, readings, {})) for one in known]


def as_sent(
    row: Outbox, epoch: int, *, late_s: float = 0.0, sent: Tick | None = None
) -> tuple[Signed, Command]:
    """Return a command of the outbox as it travels, when it is sent so late."""
    at = now() + timedelta(seconds=late_s)

    def sign(command: Command) -> Signed:
        body = msgspec.json.encode(command).decode()
        return Signed(body=body, key_id="k", signature="")

    if row.kind == "batch":
        draft = msgspec.convert(row.body, command_outbox.BatchDraft)
        command: Command = command_outbox.signed_batch(draft, epoch, sign, at=at, sent=sent)
    else:
        command = command_outbox.stamped(
            msgspec.convert(row.body, Command), epoch, at=at, sent=sent
        )
    return sign(command), command


def states(run: Run) -> list[str]:
    """Return where the jobs of a run stand, in order."""
    return list(Job.objects.filter(run=run).order_by("index").values_list("state", flat=True))


def live_locks() -> int:
    """Count the locks that hold."""
    return ResourceLock.objects.filter(released_at__isnull=True).count()


def last_run(bench: Bench, run: Run) -> dict[str, Any]:
    """What the list of workflows tells of the newest run of a workflow."""
    rows = signed_in(bench.people["observer"]).get("/api/v1/workflows").json()["workflows"]
    wanted = str(run.version.workflow_id)
    found: dict[str, Any] = next(row["last_run"] for row in rows if row["id"] == wanted)
    return found


def a_heating_run(bench: Bench) -> Run:
    """Start to heat and stir, with the approval that this needs."""
    made = a_started_run(bench, "Heat and stir")
    asked = ApprovalRequest.objects.get(run_id=made.id)
    services.decide_request(asked.id, actor=bench.people["approver"], is_approved=True, comment="x")
    return Run.objects.get(pk=made.pk)
