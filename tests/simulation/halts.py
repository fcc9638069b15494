"""Schedules in which devices are halted: they keep a set-point, fall silent, and labs are stopped.

run 0 on A: pump 0 is set, draws, delivers, is set anew      run 1 on A: pump 1 is set, draws
run 2 on B: pump 0 is set, is set anew, draws; pump 1 draws
"""

from __future__ import annotations

from itertools import accumulate
from typing import Literal, cast

from labweb.domain.crutd.operations import Update
from tests.simulation import schedule
from tests.simulation.halting import SETPOINT, HaltingHost, HaltingWorld
from tests.simulation.host import SimHost
from tests.simulation.lab import JOB, PUMPS, id_of, stroke
from tests.simulation.rows import Job
from tests.simulation.schedule import Step, drain
from tests.simulation.world import STEPS, World

Route = tuple[int, str, int, Literal["set", "draw", "deliver"], tuple[int, ...]]

ROUTES: tuple[Route, ...] = (
    (0, "A", 0, "set", ()),
    (0, "A", 0, "draw", (0,)),
    (0, "A", 0, "deliver", (1,)),
    (0, "A", 0, "set", (2,)),
    (1, "A", 1, "set", ()),
    (1, "A", 1, "draw", (4,)),
    (2, "B", 0, "set", ()),
    (2, "B", 0, "set", (6,)),
    (2, "B", 0, "draw", (7,)),
    (2, "B", 1, "draw", ()),
)


def _falls_silent(world: World, host: SimHost) -> None:
    halting_host = cast("HaltingHost", host)
    halting_host.silent.add(host.rng.choice(sorted(host.device_ids)))


def _answers_again(world: World, host: SimHost) -> None:
    cast("HaltingHost", host).silent.clear()


def _watches(world: World, host: SimHost) -> None:
    if host.is_up and host.line is not None:
        world.guarded(host, cast("HaltingHost", host).watch)


def _stops(world: World, host: SimHost) -> None:
    cast("HaltingWorld", world).stop_lab(cast("HaltingHost", host))


def _resets(world: World, host: SimHost) -> None:
    cast("HaltingWorld", world).reset(cast("HaltingHost", host))


_PUT_BACK = {schedule._copied, schedule._put_back, schedule._put_back_whole, schedule._row_lost}
"""Left to the other schedules: a person goes to a host whose journal is not the newest."""

WEIGHTS: dict[Step, float] = {
    **{step: weight for step, weight in schedule.WEIGHTS.items() if step not in _PUT_BACK},
    _falls_silent: 1.0,
    _answers_again: 2.0,
    _watches: 10.0,
    _stops: 0.6,
    _resets: 2.0,
    schedule._line_killed: 2.5,
    schedule._cancels: 1.0,
}
_STEPS = tuple(WEIGHTS)
_CUMULATIVE = tuple(accumulate(WEIGHTS.values()))


def a_halting_world(seed: int, *, trace: list[str] | None = None) -> HaltingWorld:
    """Return a lab with its runs submitted."""
    world = HaltingWorld(seed, trace=trace)
    submit(world)
    return world


def submit(world: World, routes: tuple[Route, ...] = ROUTES) -> None:
    """Submit the runs of some routes."""
    for index, (run_number, name, number, what, after) in enumerate(routes):
        pump = PUMPS[name, number]
        is_set = what == "set"
        made = Job(
            id=id_of(JOB, index + 1),
            index=index,
            run=run_number,
            host=name,
            device_id=pump.id,
            operation=Update(resource_id=pump.syringe, data={SETPOINT: 10.0 + index})
            if is_set
            else stroke(pump, is_draw=what == "draw"),
            after=after,
            action="start_flow" if is_set else "stroke",
        )
        world.server.add_job(made)


def run(seed: int, *, trace: list[str] | None = None, steps: int = STEPS) -> World:
    """Play one schedule and let it come to rest.

    Raises:
        ViolationError: An invariant does not hold.
    """
    world = a_halting_world(seed, trace=trace)
    hosts = tuple(world.hosts.values())
    for step in world.rng.choices(_STEPS, cum_weights=_CUMULATIVE, k=steps):
        world.now_s += 0.05
        step(world, hosts[world.rng.getrandbits(1)])
    drain(world)
    world.check_set()
    return world
