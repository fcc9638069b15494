"""Hosts, server and lab in which devices keep a set-point and are halted."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from random import Random
from typing import cast
from uuid import UUID

import msgspec

from labweb.domain.crutd.operations import Update
from labweb.domain.errors import Effect
from labweb.domain.messages.commands import Reset
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.host_actions import action_execution, host_state
from labweb.domain.runs.host_actions.action_execution import FoundDevice, Started
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from labweb.domain.runs.states.job_states import JobState
from tests.simulation.checks import require
from tests.simulation.directed import signed
from tests.simulation.host import SimHost
from tests.simulation.lab import DEVICE_COUNT, PUMPS, Pump
from tests.simulation.memory import MemoryWrite
from tests.simulation.rows import Host, Job
from tests.simulation.server import SimServer
from tests.simulation.world import World

SETPOINT = "rate_setpoint_ul_s"
PUMP_OF = {pump.id: pump for pump in PUMPS.values()}


class HaltingServer(SimServer):
    """Takes in what hosts tell of halts, as the services do on the rows of the database."""

    def devices_of(self, host: Host) -> list[DeviceConfig]:
        return [_config(PUMPS[host.name, number]) for number in range(DEVICE_COUNT)]

    def whole_of(self, members: list[Job]) -> frozenset[UUID]:
        """Return all that the step of these jobs needs: it begins only when all of it is free."""
        one = members[0]
        step = [job for job in self.jobs if (job.run, job.host) == (one.run, one.host)]
        return frozenset().union(*(job.targets for job in step))

    def _take_word(self, host: Host, event: EdgeEvent) -> None:
        if event.kind != "halted":
            return
        device_id = UUID(event.body["device_id"])
        self._take_from_jobs(device_id, event.body["code"])
        syringe_id = PUMP_OF[device_id].syringe
        vessel = self.vessels[syringe_id]
        gone, told = (
            halted_setpoints.voided(vessel.view.data),
            event.body["data"].get(str(syringe_id)),
        )
        if told is not None and told != gone:
            self.tickets.append("reconcile.drift")
        vessel.view = msgspec.structs.replace(vessel.view, data={**vessel.view.data, **gone})
        if gone or told:
            told_rev = event.body["revs"].get(str(syringe_id), 0)
            self._set_revs({str(syringe_id): max(vessel.view.rev + 1, told_rev)})

    def _take_from_jobs(self, device_id: UUID, code: str) -> None:
        done = self.complete_on(device_id)
        told = [
            halted_setpoints.Done(index=place, action=job.action, args={})
            for place, job in enumerate(done)
        ]
        for place in halted_setpoints.still_standing(told):
            done[place].halted_by = done[place].halted_by or code

    def complete_on(self, device_id: UUID) -> list[Job]:
        """Return the completed jobs of a device, in the order in which they were sent."""
        found = [
            job
            for job in self.jobs
            if job.device_id == device_id and job.state is JobState.COMPLETE
        ]
        return sorted(found, key=lambda job: job.actions[-1].dseq)

    def _take_event(self, host: Host, event: EdgeEvent) -> None:
        super()._take_event(host, event)
        attempt = self.attempts.get(event.action_id) if event.action_id else None
        if attempt is None or attempt.job.state is not JobState.COMPLETE:
            return
        is_undone = event.body.get(halted_setpoints.IS_HALTED) is True
        if is_undone and halted_setpoints.leaves_standing(attempt.job.action, {}):
            attempt.job.halted_by = halted_setpoints.WITH_ACTION


class HaltingHost(SimHost):
    """Halts its devices as the processes of its lines do, and remembers which it still owes."""

    def __init__(self, name: str, lab: HaltingWorld, rng: Random) -> None:
        super().__init__(name, lab, rng)
        self.pumping = lab
        self.silent: set[UUID] = set()
        self._forget()

    def new_journal(self) -> None:
        super().new_journal()
        self.owed: dict[str, dict[str, str | None]] = {}
        """What the journal said last of halts that are owed, by device."""

        self.looked_seq = 0

    def write(self, *, is_sealed: bool = True) -> MemoryWrite:
        made = super().write(is_sealed=is_sealed)
        seal = made._on_commit

        def on_commit(has_appended: bool) -> None:
            self._check_owed()
            seal(has_appended)

        made._on_commit = on_commit
        return made

    def _check_owed(self) -> None:
        """H5: until a halt is delivered, why it is due stays, and who waits for it hears of it."""
        now = msgspec.json.decode(self.disk.meta.get("owed_halts", "{}"))
        for key, due in self.owed.items():
            told = now.get(key) or self._late_halt(key)
            require(bool(told), "H5", f"a halt that was due to {due} is told to nobody")
            is_kept = told["code"] == due["code"]
            is_heard = due["action_id"] in {None, told["action_id"]}
            text = f"a halt was due to {due}, and counts now as due to {told}"
            require(is_kept and is_heard, "H5", text)
        self.owed = now
        self.looked_seq = self.disk.head[0]

    def _late_halt(self, key: str) -> dict[str, str | None]:
        """Return what this write tells of a halt of a device."""
        since = (one for one in self.disk.events if one.seq > self.looked_seq)
        bodies = (one.body for one in since if one.kind == "halted")
        return next((body for body in bodies if body["device_id"] == key), {})

    def _check_heard(self, row: ActionRow) -> None:
        """H5: some action waits to hear of the halt, this one or one before it."""
        due = self.owed.get(str(row.device_id))
        is_heard = due is not None and due["action_id"] is not None
        require(is_heard, "H5", f"dispatch {row.dseq} is not told of the halt that is owed")

    def _forget(self) -> None:
        """Begin as a process of the line does, which knows what is on disk."""
        self.is_halted = False
        self.stopped: dict[UUID, FoundDevice] = {}

    def kill_line(self) -> None:
        super().kill_line()
        self._forget()

    def _recover(self, row: ActionRow) -> Generator[str, None, None]:
        found = self.pumping.halt(self, row.device_id)
        yield "halted"
        with self.write() as tx:
            is_new = action_execution.recover(tx, row, found)
        if is_new and found.is_owed:
            self._check_heard(row)
        yield "recovered"

    def _try(self, row: ActionRow) -> Generator[str, None, bool]:
        if row.device_id in self.silent:
            return False
        return (yield from super()._try(row))

    def _after_act(self, started: Started) -> Iterator[str]:
        found = self.stopped.pop(started.row.device_id, None)
        if found is not None:
            with self.write(is_sealed=False) as tx:
                halted_setpoints.halt_with_action(tx, started.row, is_owed=found.is_owed)
            if found.is_owed:
                self._check_heard(started.row)
            yield "halt written"

    def stop(self, stop_id: UUID) -> None:
        """Take a stop of the lab, as the uplink does."""
        with self.write() as tx:
            host_state.write_stop(tx, StopLabFrame(stop_id=stop_id, issued_by="ada"))

    def watch(self) -> None:
        """Look after the latch and the halts that are owed, beside the line."""
        host = self.disk.host_state(self.boot_id)
        for device_id in sorted(map(UUID, host.owes_halt)):
            if device_id not in self.silent and not self.is_acting(device_id):
                found = self.pumping.halt(self, device_id)
                if not found.is_owed:
                    with self.write() as tx:
                        halted_setpoints.write_late_halt(tx, device_id, found.text, {})
        if host.stop_latched and not self.is_halted:
            self.is_halted = True
            for device_id in sorted(self.device_ids):
                if not self.is_acting(device_id):
                    self.pumping.halt(self, device_id)
        elif self.is_halted and not host.stop_latched:
            self._forget()

    def is_acting(self, device_id: UUID) -> bool:
        return self.acting is not None and self.acting.row.device_id == device_id


class HaltingWorld(World):
    """Knows what each device is really set to, and which must not act before it was halted."""

    def __init__(self, seed: int, *, trace: list[str] | None = None) -> None:
        self.set_to: dict[UUID, float | None] = {}
        self.loose: set[UUID] = set()
        """Devices that had to be halted since they acted last, and were not."""

        self.was_set: set[UUID] = set()
        """Actions whose device was set by them."""

        self.stopped: set[UUID] = set()
        """Actions that were under way when their lab was stopped."""

        self.unknown: set[UUID] = set()
        """Devices of which a person has said that nobody knows what they are set to."""

        self.stop_count = 0
        super().__init__(seed, trace=trace)

    def make_server(self) -> SimServer:
        return HaltingServer(self)

    def make_host(self, name: str, rng: Random) -> SimHost:
        return HaltingHost(name, self, rng)

    # --- devices ---

    def halt(self, host: SimHost, device_id: UUID) -> FoundDevice:
        """Let a device be halted; it may not hear, or hear and not say so."""
        assert isinstance(host, HaltingHost)
        if device_id in host.silent:
            return FoundDevice(is_halted=False, is_owed=True, text="it does not answer")
        if not self.is_calm and host.rng.random() < 0.15:
            if host.rng.getrandbits(1):
                self.set_to[device_id] = None
            return FoundDevice(is_halted=True, is_owed=True, text="it could not be halted")
        self.set_to[device_id] = None
        self.loose.discard(device_id)
        return FoundDevice(is_halted=True, text="it stands")

    def finish(self, host: SimHost, started: Started) -> ActionReport:
        assert isinstance(host, HaltingHost)
        row = started.row
        is_stopped = host.is_halted or host.disk.actions[row.action_id].is_cancel_wanted
        text = f"dispatch {row.dseq} acts on after its lab was stopped"
        require(is_stopped or row.action_id not in self.stopped, "H4", text)
        if self._is_update(row):
            report = self._set(host, row, is_stopped=is_stopped)
        else:
            report = super().finish(host, started)
        if is_stopped:
            self.loose.add(row.device_id)
            host.stopped[row.device_id] = self.halt(host, row.device_id)
        return report

    def _set(self, host: HaltingHost, row: ActionRow, *, is_stopped: bool) -> ActionReport:
        kind = 0.0 if self.is_calm else host.rng.random()
        if is_stopped and host.rng.getrandbits(1):
            return ActionReport(ok=False, effect=Effect.NONE, code="device.halted")
        if kind > 0.97:
            return ActionReport(ok=False, effect=Effect.NONE, code="device.refused")
        self._turn(row)
        if kind > 0.85:
            return ActionReport(ok=False, effect=Effect.UNKNOWN, code="device.silent")
        return ActionReport(ok=True)

    def _turn(self, row: ActionRow) -> None:
        self.set_to[row.device_id] = self._operation(row).data[SETPOINT]
        self.was_set.add(row.action_id)
        self.unknown.discard(row.device_id)

    def interrupted(self, host: SimHost) -> None:
        started = host.acting
        if started is None:
            return
        self.loose.add(started.row.device_id)
        if not self._is_update(started.row):
            super().interrupted(host)
            return
        host.acting = None
        if host.rng.getrandbits(1):
            self._turn(started.row)

    def _is_update(self, row: ActionRow) -> bool:
        return isinstance(self._operation(row), Update)

    # --- people ---

    def answer(self, job: Job, rng: Random) -> None:
        if not isinstance(job.operation, Update):
            super().answer(job, rng)
            return
        if not self.is_calm and rng.random() < 0.5:
            self.unknown.add(job.device_id)
            self.server.resolve(job, "discard", None)
        else:
            is_set = job.actions[-1].id in self.was_set
            self.server.resolve(job, "happened" if is_set else "did_not", None)

    def stop_lab(self, host: HaltingHost) -> None:
        """Stop one host's devices; the word reaches it over its session."""
        if not host.is_up or host.link_epoch is None or "stop_id" in host.disk.meta:
            return
        self.stop_count += 1
        self.say(f"the lab is stopped at {host.name}")
        self.loose |= host.device_ids
        self.guarded(host, lambda: host.stop(UUID(int=self.stop_count)))
        if host.acting is not None and "stop_id" in host.disk.meta:
            self.stopped.add(host.acting.row.action_id)

    def reset(self, host: HaltingHost) -> None:
        """Release the stop, by a word that only its own host takes."""
        stop_id = host.disk.meta.get("stop_id")
        if stop_id is None or not host.is_up or not host.disk.epoch:
            return
        self.say(f"the stop at {host.name} is released")
        word = Reset(
            host_id=host.id, epoch=host.disk.epoch, dseq=1, stop_id=UUID(stop_id), reason="clear"
        )
        self.guarded(host, lambda: host.take(*signed(word)))

    def settle(self, host: SimHost) -> None:
        assert isinstance(host, HaltingHost)
        host.silent.clear()
        if host.is_up and host.line is not None:
            self.guarded(host, host.watch)
        self.reset(host)
        if host.is_up and host.line is not None:
            self.guarded(host, host.watch)

    # --- what must hold ---

    def started(self, host: SimHost, row: ActionRow) -> None:
        super().started(host, row)
        is_free = row.device_id not in self.loose
        require(is_free, "H1", f"dispatch {row.dseq} starts on a device that was to be halted")
        held = host.disk.resources.get(PUMP_OF[row.device_id].syringe)
        if held is not None:
            self._check_record(row.device_id, held.view.data.get(SETPOINT), "its host")

    def _check_record(self, device_id: UUID, known: object, who: str) -> None:
        if known is None:
            return
        real = self.set_to.get(device_id)
        require(known == real, "H2", f"a pump is set to {real}; {who} has {known} on record")

    def check_set(self) -> None:
        """H2, H3: what counts as set is set, on record and as a step that was done."""
        server = cast("HaltingServer", self.server)
        for device_id, pump in PUMP_OF.items():
            self._check_record(
                device_id, server.vessels[pump.syringe].view.data.get(SETPOINT), "the server"
            )
            done = server.complete_on(device_id)
            last = next((job for job in reversed(done) if isinstance(job.operation, Update)), None)
            if last is None or last.halted_by or device_id in self.unknown:
                continue
            wanted = cast("Update", last.operation).data[SETPOINT]
            is_off = last.action == "stop_flow" and self.set_to.get(device_id) is None
            text = f"job {last.index} counts as done, and its pump is not set so"
            require(is_off or self.set_to.get(device_id) == wanted, "H3", text)


def _config(pump: Pump) -> DeviceConfig:
    return DeviceConfig(
        id=pump.id,
        key=f"pump_{pump.number}",
        name=f"pump {pump.number}",
        module="m",
        class_name="C",
        digest="d",
        transport=f"tcp://{pump.number}",
        config={},
        statuses={},
        nodes={"syringe": pump.syringe},
    )
