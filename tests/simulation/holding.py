"""Schedules of runs that keep what they use between their steps, with every fault of the others.

run 0 on A: pump 0 flows, pump 1 flows, both are stopped      run 1 on A: pump 1, pump 0, the same
run 2: into the flask of A, then into that of B               run 3: the other way round
run 4: into the flask of B
"""

from __future__ import annotations

from itertools import accumulate
from typing import Literal
from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid, Update, touched_ids
from labweb.domain.runs.exclusive_use import run_claims
from labweb.domain.runs.exclusive_use.run_claims import Claims, DeviceWay, JobProgress, Use
from labweb.domain.runs.exclusive_use.run_holds import HoldAsk, HoldScene, Party, UseMode
from labweb.domain.runs.states.job_states import FINAL, JobState, Mover
from tests.simulation import schedule
from tests.simulation.checks import SENT, require
from tests.simulation.halting import SETPOINT, HaltingServer, HaltingWorld
from tests.simulation.lab import JOB, PUMPS, id_of, stroke
from tests.simulation.rows import Attempt, Job
from tests.simulation.schedule import Step, drain
from tests.simulation.world import STEPS, World

What = Literal["start", "stop", "draw", "deliver"]
Route = tuple[int, int, str, int, What, tuple[int, ...]]

ROUTES: tuple[Route, ...] = (
    (0, 0, "A", 0, "start", ()),
    (0, 1, "A", 1, "start", (0,)),
    (0, 2, "A", 0, "stop", (1,)),
    (0, 2, "A", 1, "stop", (2,)),
    (1, 0, "A", 1, "start", ()),
    (1, 1, "A", 0, "start", (4,)),
    (1, 2, "A", 1, "stop", (5,)),
    (1, 2, "A", 0, "stop", (6,)),
    (2, 0, "A", 0, "draw", ()),
    (2, 0, "A", 0, "deliver", (8,)),
    (2, 1, "B", 0, "draw", (9,)),
    (2, 1, "B", 0, "deliver", (10,)),
    (3, 0, "B", 0, "draw", ()),
    (3, 0, "B", 0, "deliver", (12,)),
    (3, 1, "A", 1, "draw", (13,)),
    (3, 1, "A", 1, "deliver", (14,)),
    (4, 0, "B", 1, "draw", ()),
    (4, 0, "B", 1, "deliver", (16,)),
)
"""Run, step, host, pump, what it does, and what comes before."""

STEP_OF = {index: route[1] for index, route in enumerate(ROUTES)}
FLASKS = {host: PUMPS[host, 0].flask for host in ("A", "B")}
KEPT = {2: frozenset(FLASKS.values()), 3: frozenset(FLASKS.values()), 4: frozenset({FLASKS["B"]})}
"""Flask by run, from its beginning to the last use: written down here, not asked of the rules."""

KINDS = {
    node: kind
    for pump in PUMPS.values()
    for node, kind in (
        (pump.bottle, "bottle"),
        (pump.flask, "flask"),
        (pump.syringe, "syringe_pump"),
        (pump.id, "rotary_valve"),
    )
}


class HoldingServer(HaltingServer):
    """The rules of holds, as the services call them."""

    held: dict[int, dict[UUID, UseMode]]
    waiting: dict[int, HoldAsk]
    declared: dict[int, Claims]
    asked_at: dict[int, tuple[float, int]]

    def begin(self) -> None:
        """Declare what each run may use."""
        self.held, self.waiting, self.asked_at = {}, {}, {}
        runs = {one.run for one in self.jobs}
        self.declared = {
            run: run_claims.claims_of(
                [_use_of(one) for one in self.jobs if one.run == run], KINDS, ["0", "1", "2"]
            )
            for run in runs
        }
        for run in runs:
            self.held[run] = {}

    def stands(self, run: int) -> list[JobProgress]:
        """Return where the jobs of a run stand."""
        return [
            run_claims.stand_of(one.index, one.state, "", one.halted_by)
            for one in self.jobs
            if one.run == run
        ]

    def may_hold(self, members: list[Job]) -> bool:
        """Give a run what it has to hold for these jobs; False: it waits."""
        run = members[0].run
        self.asked_at.setdefault(run, (self.watch.now_s, run))  # as an onlooker sees it
        held, stands, declared = self.held[run], self.stands(run), self.declared[run]
        used = frozenset().union(*(one.targets for one in members))
        sent = [one.index for one in members]
        asked = run_claims.asked_by(declared, stands, sent, used, held)
        if not asked:
            return True
        scene = HoldScene(
            parties=[self._party(other) for other in sorted(self.held)],
            waiting=[ask for other, ask in sorted(self.waiting.items()) if self._waits(other)],
        )
        turn = self.waiting[run].turn if run in self.waiting else (self.watch.now_s, run)
        whole = HoldAsk(run_id=id_of(0, run), turn=turn, wanted=run_claims.modes_in(asked))
        refused, kept = run_claims.decide(self._party(run), whole, asked, scene)
        if refused is not None:
            self.waiting[run] = kept
            return False
        return self._take(run, asked, turn, members)

    def _take(
        self,
        run: int,
        asked: list[run_claims.RunClaim],
        turn: tuple[float, int],
        members: list[Job],
    ) -> bool:
        """Take what was granted; where a lock is in the way, keep the place in the line."""
        targets = frozenset().union(*(one.targets for one in members))
        in_use = {lock.resource_id for one in self.attempts.values() for lock in one.locks}
        if not targets.isdisjoint(in_use):
            wanted = run_claims.modes_in(one for one in asked if one.is_kept)
            self.waiting[run] = HoldAsk(run_id=id_of(0, run), turn=turn, wanted=wanted)
            return False
        self.waiting.pop(run, None)
        held = self.held[run]
        for node, mode in run_claims.modes_in(asked).items():
            held[node] = mode if held.get(node) in {None, mode} else UseMode.ALONE
        return True

    def _waits(self, run: int) -> bool:
        return any(one.run == run and one.state is JobState.QUEUED for one in self.jobs)

    def _party(self, run: int) -> Party:
        held, stands = self.held[run], self.stands(run)
        needs, choices = run_claims.needs_of(self.declared[run], stands, held)
        if all(one.state in FINAL for one in self.jobs if one.run == run):
            needs = {}
        has_begun = bool(held) or any(one.has_acted for one in stands)
        return Party(
            id=id_of(0, run), has_begun=has_begun, held=dict(held), needs=needs, choices=choices
        )

    def move(self, job_: Job, state: JobState, mover: Mover) -> None:
        """Move a job, and let go what its run cannot need any more."""
        super().move(job_, state, mover)
        run = job_.run
        if state is JobState.DISPATCHED:
            return
        has_ended = all(one.state in FINAL for one in self.jobs if one.run == run)
        stands = self.stands(run)
        held = self.held[run]
        gone = run_claims.released(self.declared[run], stands, held, has_ended=has_ended)
        for node in gone:
            del held[node]


def _use_of(one: Job) -> Use:
    way = DeviceWay(
        device_id=one.device_id, operation=one.operation, args={}, locks=tuple(sorted(one.targets))
    )
    return Use(index=one.index, step_id=str(STEP_OF[one.index]), action=one.action, ways=(way,))


class HoldingWorld(HaltingWorld):
    """A lab, and what an onlooker sees of who uses what."""

    server: HoldingServer

    def make_server(self) -> HoldingServer:
        return HoldingServer(self)

    def dispatched(self, attempt: Attempt) -> None:
        """W1, W2: nobody walks through another's run, and nobody overtakes."""
        super().dispatched(attempt)
        fresh = attempt.job
        for run in {one.run for one in self.server.jobs} - {fresh.run}:
            both = fresh.targets & self._kept_by(run)
            require(not both, "W1", f"job {fresh.index} uses what run {run} keeps")
        own = [one for one in self.server.jobs if one.run == fresh.run]
        if sum(len(one.actions) for one in own) > 1:
            return
        turn = self.server.asked_at.get(fresh.run, (self.now_s, fresh.run))
        for run, asked_at in self.server.asked_at.items():
            is_first = run != fresh.run and asked_at < turn
            first = next(one for one in self.server.jobs if one.run == run)
            if is_first and first.state is JobState.QUEUED and not first.actions:
                needed = self._needed_by(run) & self._needed_by(fresh.run)
                require(not needed, "W2", f"run {fresh.run} overtakes run {run}")

    def _needed_by(self, run: int) -> set[UUID]:
        """What jobs of a run that have not ended use of what it keeps."""
        return {
            node
            for node in KEPT.get(run, ())
            for one in self.server.jobs
            if one.run == run and node in touched_ids(one.operation) and one.state not in FINAL
        }

    def _kept_by(self, run: int) -> set[UUID]:
        own = [one for one in self.server.jobs if one.run == run]
        if not any(one.actions for one in own) or all(one.state in FINAL for one in own):
            return set()
        kept = self._needed_by(run)
        for one in own:
            is_on = one.state in SENT or one.state is JobState.COMPLETE
            if one.action == "start_flow" and is_on and not one.halted_by:
                ends = (other for other in own if other.action == "stop_flow")
                stop = next(other for other in ends if other.device_id == one.device_id)
                if stop.state not in FINAL:
                    kept.add(one.device_id)
        return kept

    def check_holds(self) -> None:
        """W3: who has ended keeps nothing."""
        for run, held in self.server.held.items():
            require(not held, "W3", f"run {run} has ended and keeps {len(held)} things")


WEIGHTS: dict[Step, float] = {
    step: weight
    for step, weight in schedule.WEIGHTS.items()
    if step not in {schedule._put_back, schedule._put_back_whole, schedule._row_lost}
}
_STEPS = tuple(WEIGHTS)
_CUMULATIVE = tuple(accumulate(WEIGHTS.values()))


def a_holding_world(seed: int, *, trace: list[str] | None = None) -> HoldingWorld:
    """Return a lab with its runs submitted."""
    world = HoldingWorld(seed, trace=trace)
    for index, (run_number, _, name, number, what, after) in enumerate(ROUTES):
        pump = PUMPS[name, number]
        operation: TransferLiquid | Update
        if what in {"start", "stop"}:
            value = 10.0 + index if what == "start" else 0.0
            operation = Update(resource_id=pump.syringe, data={SETPOINT: value})
        else:
            operation = stroke(pump, is_draw=what == "draw")
        action = {"start": "start_flow", "stop": "stop_flow"}.get(what, "stroke")
        made = Job(
            id=id_of(JOB, index + 1),
            index=index,
            run=run_number,
            host=name,
            device_id=pump.id,
            operation=operation,
            after=after,
            action=action,
        )
        world.server.add_job(made)
    world.server.begin()
    return world


def run(seed: int, *, trace: list[str] | None = None, steps: int = STEPS) -> World:
    """Play one schedule and let it come to rest.

    Raises:
        ViolationError: An invariant does not hold.
    """
    world = a_holding_world(seed, trace=trace)
    hosts = tuple(world.hosts.values())
    for step in world.rng.choices(_STEPS, cum_weights=_CUMULATIVE, k=steps):
        world.now_s += 0.05
        step(world, hosts[world.rng.getrandbits(1)])
    drain(world)
    world.check_set()
    world.check_holds()
    return world
