"""One schedule: what happens to two hosts, a server and what lies between, from one seed."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from random import Random
from typing import Any

from labweb.domain.errors import Effect, StateError
from labweb.domain.messages.commands import Command
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.host_actions.action_execution import Started
from labweb.domain.runs.host_journal.action_states import ActionReport, ActionState
from labweb.domain.runs.host_journal.journal_rows import ActionRow, JournalError
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import FINAL, JobState, Mover
from tests.simulation import checks
from tests.simulation.checks import require
from tests.simulation.host import KilledError, SimHost
from tests.simulation.lab import HOSTS, JOB, PUMPS, STROKE_NL, Matter, id_of, stroke
from tests.simulation.link import Link
from tests.simulation.rows import Attempt, Host, Job, Policy
from tests.simulation.server import SimServer

STEPS, DRAIN_ROUNDS = 220, 400
Post = tuple[Signed, Command]


class World:
    """Everything of one schedule."""

    def __init__(self, seed: int, *, trace: list[str] | None = None) -> None:
        self.rng = Random(seed)
        self.trace = trace
        self.now_s = self.server_up_at_s = 1000.0
        self.matter = Matter()
        self.server = self.make_server()
        self.hosts = {name: self.make_host(name, Random(f"{seed} {name}")) for name in HOSTS}
        self.brokers: dict[str, deque[Post]] = {name: deque() for name in HOSTS}
        self.links: dict[str, list[Link]] = {name: [] for name in HOSTS}
        self.is_cut_off: dict[str, set[str]] = {name: set() for name in HOSTS}
        self.last_start: dict[Any, int] = {}
        self.is_calm = False
        for host in self.hosts.values():
            self.guarded(host, partial(host.start, is_cold=True))

    def make_server(self) -> SimServer:
        return SimServer(self)

    def make_host(self, name: str, rng: Random) -> SimHost:
        return SimHost(name, self, rng)

    def say(self, text: str) -> None:
        if self.trace is not None:
            self.trace.append(f"{self.now_s - 1000:8.1f} s  {text}")

    # --- what the server reports ---

    def moved(self, job: Job, before: JobState, mover: Mover) -> None:
        if self.trace is not None:
            self.say(f"job {job.index}: {before.value} → {job.state.value} ({mover.value})")
        checks.check_move(self, job, before, mover)

    def fenced(self, host: Host, code: str) -> None:
        self.say(f"host {host.name} is quarantined: {code}")
        there = self.hosts[host.name]
        has_cause = there.was_put_back or there.lost_rows or there.is_lost
        require(has_cause, "Q", f"host {host.name} is quarantined without a cause: {code}")

    def signed(self, host: Host, people: set[str]) -> None:
        self.say(f"host {host.name} is fenced by {' and '.join(sorted(people))}")
        require(len(people) == 2, "I16", f"host {host.name} is fenced by one person")

    def dispatched(self, attempt: Attempt) -> None:
        checks.check_dispatch(self, attempt)

    def ingested(self, host: Host, fresh: Sequence[EdgeEvent]) -> None:
        if self.trace is not None:
            kinds = " ".join(event.kind for event in fresh)
            self.say(f"server reads {fresh[0].seq}… of {host.name}: {kinds}")
        checks.check_log(host, fresh)

    def ring(self, host: str, signed: Signed, command: Command) -> None:
        self.brokers[host].append((signed, command))
        if self.trace is not None:
            self.say(f"server sends {type(command).__name__} {command.dseq} to {host}")

    # --- what hosts do to matter ---

    def started(self, host: SimHost, row: ActionRow) -> None:
        """I13: an action is allowed to start; judged by what only an onlooker knows."""
        floor = int(host.disk.meta.get("floor", 0))
        require(row.dseq >= floor, "I13", f"dispatch {row.dseq} is below the floor {floor}")
        last = self.last_start.get(row.device_id, 0)
        require(row.dseq > last, "I13", f"dispatch {row.dseq} starts after {last}")
        self.last_start[row.device_id] = row.dseq
        require(host.resumed_boot == host.boot_count, "I13", "starts before a session in this boot")
        require(not host.is_put_back, "I13", "starts on a journal that was put back from a copy")
        require("stop_id" not in host.disk.meta, "I14", "starts while the lab is stopped")
        doubtful = host.disk.rows(ActionState.IN_DOUBT)
        is_closed = any(one.device_id == row.device_id for one in doubtful)
        require(not is_closed, "I14", "starts on a device with an action in doubt")
        checks.check_turn(self, host, self.server.attempts[row.action_id])

    def link_lost(self, host: SimHost) -> None:
        checks.check_stopped(self, host)

    def begin(self, host: SimHost, started: Started) -> None:
        """The first byte: from here on the device acts by itself."""
        row = started.row
        self.matter.count[row.action_id] += 1
        count = self.matter.count[row.action_id]
        if self.trace is not None:
            self.say(f"{host.name} acts: dispatch {row.dseq}")
        require(count == 1, "I1", f"dispatch {row.dseq} of {host.name} happened {count} times")
        written = host.disk.actions[row.action_id].st
        require(written is ActionState.STARTED, "I13", "acts before the start is on disk")

    def finish(self, host: SimHost, started: Started) -> ActionReport:
        """The device answers."""
        row, amount_nl = started.row, STROKE_NL
        kind = 0.0 if self.is_calm else host.rng.random()
        is_cancelled = host.disk.actions[row.action_id].is_cancel_wanted
        moved_nl = amount_nl
        if is_cancelled or kind > 0.94:
            moved_nl = host.rng.choice((0, amount_nl // 4, amount_nl))
        self.matter.pour(row.action_id, self._operation(row), moved_nl)
        if moved_nl == amount_nl and kind <= 0.97:
            return ActionReport(ok=True, moved_nl=moved_nl)
        if kind > 0.97:
            return ActionReport(ok=False, effect=Effect.UNKNOWN, code="device.silent")
        effect = Effect.PARTIAL if moved_nl else Effect.NONE
        return ActionReport(ok=False, effect=effect, moved_nl=moved_nl, code="device.halted")

    def interrupted(self, host: SimHost) -> None:
        """A device whose driver died goes on by itself, or not."""
        started, host.acting = host.acting, None
        if started is not None:
            moved_nl = host.rng.choice((0, STROKE_NL // 4, STROKE_NL, STROKE_NL))
            self.matter.pour(started.row.action_id, self._operation(started.row), moved_nl)

    def _operation(self, row: ActionRow) -> Any:  # noqa: ANN401 - a stroke
        return self.server.attempts[row.action_id].job.operation

    def accepted(self, host: SimHost, row: ActionRow) -> None:
        if row.st is ActionState.ACCEPTED:
            text = f"dispatch {row.dseq} of session {row.epoch} in session {host.disk.epoch}"
            require(row.epoch == host.disk.epoch, "I13", text)

    # --- steps of the host's processes ---

    def guarded(self, host: SimHost, work: Callable[[], object]) -> None:
        """Let a process of a host work; a refused write ends it, a kill ends the host."""
        try:
            work()
        except KilledError:
            self.say(f"{host.name} dies between the write and its seal")
            self.kill_host(host)
        except JournalError as error:
            self.say(f"{host.name}: {error.message}")
            self.kill_host(host)

    def step_line(self, host: SimHost) -> None:
        """Let the line go on to its next place to die."""
        if not host.is_up:
            self.guarded(host, lambda: host.start(is_cold=False))
            return
        if host.line is None:
            host.line = host._work()

        def go() -> None:
            assert host.line is not None
            host.where = next(host.line)

        self.guarded(host, go)

    def step_broker(self, host: SimHost) -> None:
        """Deliver one message, not always the oldest."""
        waiting = self.brokers[host.name]
        if not waiting or not host.is_up or "broker" in self.is_cut_off[host.name]:
            return
        if not self.is_calm and host.rng.random() < 0.2:
            waiting.rotate(host.rng.randrange(len(waiting)))
        signed, command = waiting.popleft()

        def take() -> None:
            answer = host.take(signed, command)
            if self.trace is not None:
                name = f"{type(command).__name__} {command.dseq} of session {command.epoch}"
                self.say(f"{host.name} takes {name}: {answer}")

        self.guarded(host, take)

    def step_uplink(self, host: SimHost) -> None:
        """Connect, or tell the next events, or notice that nobody answers."""
        if not host.is_up:
            return
        link = host.link
        if link is None:
            if "uplink" not in self.is_cut_off[host.name]:
                self.guarded(host, lambda: self.links[host.name].append(host.connect()))
                del self.links[host.name][:-3]
        elif link.is_closed_at_server or host.is_silent():
            host.kill_uplink()
        else:
            host.tell_events()

    def step_up(self, host: SimHost) -> None:
        """Carry one frame to the server, of the present connection or of one before."""
        if "uplink" in self.is_cut_off[host.name]:
            return
        for link in self.links[host.name]:
            if link.up and not link.is_cut and not link.is_closed_at_server:
                self.server.hear(link, link.up.popleft())
                return

    def step_down(self, host: SimHost) -> None:
        """Carry one frame to the host."""
        link = host.link
        if link is None or not link.down or link.is_cut or not host.is_up:
            return
        if "uplink" in self.is_cut_off[host.name]:
            return
        frame = link.down.popleft()
        self.guarded(host, lambda: host.hear(frame, self._resumed))

    def _resumed(self, host: SimHost) -> None:
        host.resumed_boot = host.boot_count

    def pass_time(self, seconds: float) -> None:
        """Let time pass; connected hosts beat meanwhile."""
        self.now_s += seconds
        for host in self.hosts.values():
            link = host.link
            if (
                host.is_up
                and link is not None
                and not link.is_cut
                and host.link_epoch is not None
                and "uplink" not in self.is_cut_off[host.name]
            ):
                self.server.beat(link, self.server.host(host.name))
        self.server.watch_hosts()
        self.server.isolate()
        checks.check_isolation(self)

    # --- faults ---

    def kill_host(self, host: SimHost) -> None:
        self.interrupted(host)
        host.kill()

    def cut(self, link: Link) -> None:
        """Break a connection; what was on the wire is lost."""
        link.is_cut = True
        link.cut_at_s = self.now_s

    def restart_server(self) -> None:
        """End every process of the server; its database stays."""
        self.say("the server restarts")
        for links in self.links.values():
            for link in links:
                link.is_closed_at_server = True
                link.up.clear()
                link.down.clear()
        self.server_up_at_s = self.now_s

    def put_back(self, host: SimHost) -> None:
        """Put the journal back from a copy; the seal stays where it is."""
        if not host.copies:
            return
        disk, _ = host.rng.choice(host.copies)
        self.kill_host(host)
        host.disk = disk.copy()
        host.lost_rows.clear()
        seal = host.seal
        # A write that never reached the seal was never acted upon: losing it is harmless.
        is_same = seal is None or (
            disk.journal_id == seal.journal_id and disk.hash_at(seal.seq) == seal.hash
        )
        host.was_put_back = True
        host.is_put_back = not is_same
        if not is_same:
            self.say(f"{host.name}: the journal is put back to event {host.disk.head[0]}")

    def put_back_whole(self, host: SimHost) -> None:
        """Put journal and seal back together and reboot, behind what the server has read.

        Not while the machine is broken: it could not boot from it.
        """
        known = self.server.host(host.name).record
        if host.is_lost:
            return
        for disk, seal in host.copies:
            if disk.journal_id == known.journal_id and disk.head[0] < known.acked_seq:
                self.kill_host(host)
                host.disk, host.seal = disk.copy(), seal
                host.lost_rows.clear()
                host.is_put_back = host.was_put_back = True
                self.say(f"{host.name}: the whole disk is put back to event {disk.head[0]}")
                self.guarded(host, lambda: host.start(is_cold=True))
                return

    def settle(self, host: SimHost) -> None:
        """Let the faults of a host end that only some schedules know."""

    # --- people ---

    def answer(self, job: Job, rng: Random) -> None:
        """Look at the vessels and say what happened."""
        try:
            self._answer(job, rng)
        except StateError:
            self.server.resolve(job, "discard", None)

    def _answer(self, job: Job, rng: Random) -> None:
        action = job.actions[-1].id
        moved_nl = self.matter.moved_nl.get(action, 0)
        if not self.is_calm and rng.random() < 0.15:
            self.server.resolve(job, "discard", None)
        elif moved_nl == 0:
            self.server.resolve(job, "did_not", None)
        elif moved_nl == STROKE_NL:
            self.server.resolve(job, "happened", None)
        else:
            self.server.resolve(job, "partly", moved_nl)

    def take_stock(self) -> None:
        """Measure what is closed and has no open job."""
        for vessel_id, vessel in self.server.vessels.items():
            if vessel.quarantined_by is not None:
                attempt = next(
                    one
                    for one in self.server.attempts.values()
                    if str(one.id) == vessel.quarantined_by
                )
                if attempt.job.state in FINAL:
                    self.server.take_stock(vessel_id, self.matter.nl[vessel_id])

    def set_aside(self, host: SimHost) -> None:
        """Go to a quarantined host: end it, set its journal aside, let it in again."""
        known = self.server.host(host.name)
        if known.state not in {SessionState.QUARANTINED, SessionState.FENCED}:
            return
        host.is_lost = False
        self.say(f"a person sets the journal of {host.name} aside")
        self.kill_host(host)
        host.new_journal()
        host.is_put_back = host.was_put_back = False
        host.lost_rows.clear()
        self.server.readmit(known)
        # Its connections are closed with it: a HELLO of the old journal may be on the wire.
        for link in self.links[host.name]:
            link.is_closed_at_server = True
        self.guarded(host, lambda: host.start(is_cold=False))


Route = tuple[int, str, int, bool, tuple[int, ...]]

ROUTES: tuple[Route, ...] = (
    (0, "A", 0, True, ()),
    (0, "A", 0, False, (0,)),
    (1, "A", 1, True, ()),
    (1, "B", 0, True, (2,)),
    (1, "B", 1, True, (2,)),
    (1, "B", 0, False, (3,)),
)
"""Run, host, pump, whether it draws, and what comes before: the second run goes on to B."""


APART: tuple[Route, ...] = (
    (0, "A", 0, True, ()),
    (0, "A", 0, False, (0,)),
    (1, "B", 0, True, ()),
    (1, "B", 0, False, (2,)),
    (2, "B", 1, True, ()),
)
"""The same for two hosts that have nothing to do with each other."""


def add_jobs(
    world: World, routes: tuple[Route, ...] = ROUTES, policies: Mapping[int, Policy] | None = None
) -> None:
    """Submit the runs; those with a policy go in batches."""
    for index, (run, name, number, is_draw, after) in enumerate(routes):
        pump = PUMPS[name, number]
        made = Job(
            id=id_of(JOB, index + 1),
            index=index,
            run=run,
            host=name,
            device_id=pump.id,
            operation=stroke(pump, is_draw=is_draw),
            after=after,
            policy=(policies or {}).get(run),
        )
        world.server.add_job(made)
