"""Schedules whose runs go in batches, with every fault of the others.

run 0 on A: pump 0 draws, delivers, pump 1 draws, delivers      run 1: A, then B, then A again
"""

from __future__ import annotations

from itertools import accumulate
from random import Random

from labweb.domain.runs.states.job_states import JobState
from tests.simulation import schedule
from tests.simulation.host import SimHost
from tests.simulation.rows import Policy
from tests.simulation.schedule import Step, drain
from tests.simulation.world import STEPS, Route, World, add_jobs

ROUTES: tuple[Route, ...] = (
    (0, "A", 0, True, ()),
    (0, "A", 0, False, (0,)),
    (0, "A", 1, True, (1,)),
    (0, "A", 1, False, (2,)),
    (1, "B", 0, True, ()),
    (1, "B", 1, True, ()),
    (1, "B", 0, False, (4, 5)),
    (1, "A", 0, True, (6,)),
    (1, "A", 0, False, (7,)),
)

POLICIES = (
    Policy("continue", 60.0),
    Policy("continue", 8.0),
    Policy("finish_current_then_hold", 0.0),
    Policy("stop_safe", 0.0),
)


def _recalls(world: World, host: SimHost) -> None:
    run = host.rng.getrandbits(1)
    world.say(f"a person pauses run {run}")
    world.server.recall(run)


def _resumes(world: World, host: SimHost) -> None:
    world.server.resume(host.rng.getrandbits(1))


def _retries(world: World, host: SimHost) -> None:
    for job in world.server.jobs:
        if job.host == host.name and job.state is not JobState.QUEUED:
            world.server.retry(job)


def _link_noticed(world: World, host: SimHost) -> None:
    """The uplink process ends and begins again: it writes down that the server is away."""
    if host.is_up:
        host.kill_uplink()
        world.guarded(host, host.lose_link)


def _lost(world: World, host: SimHost) -> None:
    """The machine breaks; it starts no more until somebody has mended it."""
    world.say(f"{host.name} is lost")
    world.kill_host(host)
    host.is_lost = True


def _signs(world: World, host: SimHost) -> None:
    """A person who has seen that the machine is dead signs for it."""
    if host.is_lost:
        world.server.sign_fence(host.name, host.rng.choice(("ada", "bob")))


WEIGHTS: dict[Step, float] = {
    **schedule.WEIGHTS,
    _recalls: 0.6,
    _resumes: 1.5,
    _retries: 1.0,
    _link_noticed: 0.8,
    _lost: 0.3,
    _signs: 4.0,
}
_STEPS = tuple(WEIGHTS)
_CUMULATIVE = tuple(accumulate(WEIGHTS.values()))


def run(seed: int, *, trace: list[str] | None = None, steps: int = STEPS) -> World:
    """Play one schedule and let it come to rest.

    Raises:
        ViolationError: An invariant does not hold.
    """
    world = World(seed, trace=trace)
    choice = Random(f"policies {seed}")
    add_jobs(world, ROUTES, {run: choice.choice(POLICIES) for run in (0, 1)})
    hosts = tuple(world.hosts.values())
    for step in world.rng.choices(_STEPS, cum_weights=_CUMULATIVE, k=steps):
        world.now_s += 0.05
        step(world, hosts[world.rng.getrandbits(1)])
    drain(world)
    return world
