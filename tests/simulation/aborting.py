"""Hosts, server and lab in which runs are aborted and single devices are stopped."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import cast
from uuid import UUID

from labweb.domain.messages.commands import Command, Halt
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.dispatch import job_scheduler
from labweb.domain.runs.halts import halt_progress, halted_setpoints
from labweb.domain.runs.halts.halt_progress import OPEN_HALTS, UNDECIDED, HaltState
from labweb.domain.runs.host_journal.action_states import ActionState
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from labweb.domain.runs.states.job_states import AT_EDGE, FINAL, JobState, Mover, RunState
from tests.simulation.checks import require
from tests.simulation.halting import PUMP_OF, HaltingHost, HaltingServer, HaltingWorld
from tests.simulation.host import SimHost
from tests.simulation.lab import id_of
from tests.simulation.rows import Host, Job, Row
from tests.simulation.server import SimServer

HALT, RUN = 900_000, 800_000
_ACTING = {JobState.RUNNING, JobState.COMPLETING, JobState.IN_DOUBT}


@dataclass(eq=False)
class Wish:
    """One wish to halt one device."""

    id: UUID
    host: str
    device_id: UUID
    run: int | None
    code: str
    state: HaltState = HaltState.ASKED
    is_taken: bool = False


class AbortingServer(HaltingServer):
    """Aborts runs, as the services do on the rows of the database."""

    given_up: set[int]
    wishes: list[Wish]
    ended: dict[int, RunState]
    answers: dict[UUID, str]
    """What people have answered of actions in doubt."""

    # --- people ---

    def abort(self, run: int) -> None:
        """Give a run up: cancel what was sent, and halt what stands."""
        self.given_up.add(run)
        for made in self.jobs:
            if made.run == run:
                self.cancel(made)
        self._halt_what_stands(run)
        self._look_at(run)

    def stop_device(self, host: str, device_id: UUID) -> None:
        """Halt one device, whatever acts on it."""
        known = [one for one in self.wishes if one.run is None and one.device_id == device_id]
        if all(one.state not in OPEN_HALTS for one in known):
            self._ask(host, device_id, None, halted_setpoints.DEVICE_STOPPED)

    def resolve(self, made: Job, answer: str, moved_nl: int | None) -> None:
        self.answers[made.actions[-1].id] = answer
        super().resolve(made, answer, moved_nl)

    def resume(self, run: int) -> None:
        if run not in self.given_up:
            super().resume(run)

    def retry(self, made: Job) -> None:
        if made.run not in self.given_up:
            super().retry(made)

    def dispatch(self, made: Job) -> None:
        is_halting = any(
            one.device_id == made.device_id and one.state in OPEN_HALTS for one in self.wishes
        )
        if not is_halting:
            super().dispatch(made)

    def readmit(self, host: Host) -> None:
        super().readmit(host)
        for one in self.wishes:
            if one.host == host.name and one.state in OPEN_HALTS:
                one.state, one.is_taken = HaltState.OWED, False
                self._send(one)

    # --- what follows ---

    def _halt_what_stands(self, run: int) -> None:
        sent = [made for made in self.jobs if made.run == run and made.actions]
        for device_id in sorted({made.device_id for made in sent}):
            jobs = [made for made in sent if made.device_id == device_id]
            mine = [one for one in self.wishes if one.run == run and one.device_id == device_id]
            asked = {one.state for one in mine}
            standing = self._standing(device_id)
            other = halt_progress.who_keeps(id_of(RUN, run + 1), standing)
            is_in_question = not asked and self._is_in_question(device_id, run)
            is_ours = is_in_question or any(one.run_id == id_of(RUN, run + 1) for one in standing)
            acts = any(made.state in _ACTING for made in jobs)
            if (acts and not asked) or (is_ours and other is None and OPEN_HALTS.isdisjoint(asked)):
                self._ask(jobs[0].host, device_id, run, halted_setpoints.RUN_ABORTED)

    def _standing(self, device_id: UUID) -> list[halt_progress.Set]:
        done = self.complete_on(device_id)
        told = [
            halted_setpoints.Done(index=at, action=one.action, args={})
            for at, one in enumerate(done)
        ]
        found = [done[at] for at in halted_setpoints.still_standing(told) if not done[at].halted_by]
        found += [
            made
            for made in self.jobs
            if made.device_id == device_id
            and made.state in AT_EDGE
            and halted_setpoints.leaves_standing(made.action, {})
        ]
        return [
            halt_progress.Set(run_id=id_of(RUN, made.run + 1), is_live=self.is_live(made.run))
            for made in found
        ]

    def _is_in_question(self, device_id: UUID, run: int) -> bool:
        """Say whether a job that a person has given up may have left its device going."""
        told = [
            made
            for made in self.jobs
            if made.device_id == device_id
            and made.actions
            and (made.state is JobState.COMPLETE or (made.run == run and self._is_given_up(made)))
        ]
        told.sort(key=lambda made: made.actions[-1].dseq)
        return bool(
            halted_setpoints.may_stand(
                halted_setpoints.Done(
                    index=at,
                    action=made.action,
                    args={},
                    is_known=made.state is JobState.COMPLETE,
                )
                for at, made in enumerate(told)
            )
        )

    def _is_given_up(self, made: Job) -> bool:
        return made.state is JobState.ABORTED and self.answers.get(made.actions[-1].id) == "discard"

    def is_live(self, run: int) -> bool:
        return run not in self.given_up and any(
            made.state not in FINAL for made in self.jobs if made.run == run
        )

    def _ask(self, host: str, device_id: UUID, run: int | None, code: str) -> None:
        made = Wish(id_of(HALT, len(self.wishes) + 1), host, device_id, run, code)
        self.wishes.append(made)
        self._send(made)

    def _send(self, made: Wish) -> None:
        host = self.host(made.host)
        command = Halt(
            host_id=host.record.host_id,
            epoch=host.record.epoch,
            dseq=host.record.last_dseq,
            halt_id=made.id,
            device_id=made.device_id,
            code=made.code,
        )
        host.outbox.append(Row(command, made.id, "halt"))

    def _take_event(self, host: Host, event: EdgeEvent) -> None:
        super()._take_event(host, event)
        attempt = self.attempts.get(event.action_id) if event.action_id else None
        if attempt is not None and attempt.job.run in self.given_up:
            if attempt.job.state is JobState.HELD:
                self.move(attempt.job, JobState.STOPPED, Mover.SERVER)
            if attempt.job.run not in self.ended:
                self._halt_what_stands(attempt.job.run)
        for run in sorted(self.given_up):
            self._look_at(run)

    def _take_word(self, host: Host, event: EdgeEvent) -> None:
        super()._take_word(host, event)
        body = event.body
        if event.kind == "halt_taken":
            wish = next(one for one in self.wishes if str(one.id) == body["halt_id"])
            require(not wish.is_taken, "H7", f"halt {wish.id.int} came into force twice")
            wish.is_taken, wish.state = True, HaltState.TAKEN
            for row in host.outbox:
                row.is_answered = row.is_answered or row.action_id == wish.id
        taken = [
            one
            for one in self.wishes
            if str(one.device_id) == body.get("device_id") and one.is_taken
        ]
        for one in taken:
            if event.kind == "halt_waits" and one.state in OPEN_HALTS:
                one.state = HaltState.OWED
            if event.kind == "halted" and body.get("message") and one.state in OPEN_HALTS:
                one.state = HaltState.HALTED

    def _look_at(self, run: int) -> None:
        """H8: a run that was aborted ends, and not before something is known of its halts."""
        views = [made.view for made in self.jobs if made.run == run]
        is_halting = any(one.run == run and one.state in UNDECIDED for one in self.wishes)
        state = job_scheduler.run_state(
            RunState.RUNNING, views, is_given_up=True, is_halting=is_halting
        )
        if state in {RunState.ABORTED, RunState.COMPLETE} and run not in self.ended:
            self.ended[run] = state
            require(not is_halting, "H8", f"run {run} ends while a device is still being halted")


class AbortingHost(HaltingHost):
    """Takes halts of single devices, and tells why one waits."""

    def take(self, signed: Signed, command: Command) -> str:
        world = cast("AbortingWorld", self.lab)
        before = self.disk.head[0]
        told = super().take(signed, command)
        if isinstance(command, Halt) and self.disk.head[0] > before:
            world.halt_taken(self, command)
        return told

    def watch(self) -> None:
        super().watch()
        for device_id in sorted(map(UUID, self.disk.host_state(self.boot_id).owes_halt)):
            if device_id in self.silent:
                with self.write() as tx:
                    halted_setpoints.note_waiting(tx, device_id, "it does not answer")


class AbortingWorld(HaltingWorld):
    """Knows which run has set each device, and what must not begin after its stop."""

    def __init__(self, seed: int, *, trace: list[str] | None = None) -> None:
        self.set_by: dict[UUID, int] = {}
        self.waiting: set[UUID] = set()
        """Actions that had not begun when a person stopped their device."""

        super().__init__(seed, trace=trace)

    def make_server(self) -> SimServer:
        server = AbortingServer(self)
        server.given_up, server.wishes, server.ended = set(), [], {}
        server.answers = {}
        return server

    def make_host(self, name: str, rng: Random) -> SimHost:
        return AbortingHost(name, self, rng)

    def halt_taken(self, host: AbortingHost, halt: Halt) -> None:
        """Note what a halt means for what acts and waits at its device."""
        self.loose.add(halt.device_id)
        if host.acting is not None and host.is_acting(halt.device_id):
            self.stopped.add(host.acting.row.action_id)
        if halt.code == halted_setpoints.DEVICE_STOPPED:
            waiting = host.disk.actions.values()
            self.waiting |= {
                row.action_id
                for row in waiting
                if row.device_id == halt.device_id and row.st is ActionState.ACCEPTED
            }

    def started(self, host: SimHost, row: ActionRow) -> None:
        super().started(host, row)
        text = f"dispatch {row.dseq} begins though its device was stopped while it waited"
        require(row.action_id not in self.waiting, "H9", text)

    def _turn(self, row: ActionRow) -> None:
        super()._turn(row)
        self.set_by[row.device_id] = self.server.attempts[row.action_id].job.run

    def check_aborted(self) -> None:
        """H6, H8: no device goes on for an aborted run, and every such run has ended."""
        server = cast("AbortingServer", self.server)
        for device_id in PUMP_OF:
            run = self.set_by.get(device_id)
            is_on = self.set_to.get(device_id) is not None
            if run in server.given_up and is_on:
                live = {one.run for one in server.complete_on(device_id)} - server.given_up
                require(bool(live), "H6", f"run {run} was aborted, and a pump that it set runs on")
        left = server.given_up - set(server.ended)
        require(not left, "H8", f"runs {sorted(left)} were aborted and never end")
