"""Schedules in which runs are aborted and devices stopped, with every fault of `halts`.

run 0 on A: pump 0 is set, draws, delivers, is set anew      run 1 on A: pump 1 is set, draws
run 2 on B: pump 0 is set, is set anew, draws; pump 1 draws
run 3 on A, behind run 0: pump 0 is set, draws
"""

from __future__ import annotations

from itertools import accumulate
from typing import cast

from labweb.domain.runs.states.job_states import FINAL
from tests.simulation import halts, schedule
from tests.simulation.aborting import AbortingServer, AbortingWorld
from tests.simulation.host import SimHost
from tests.simulation.schedule import Step, drain
from tests.simulation.world import STEPS, World

ROUTES: tuple[halts.Route, ...] = (
    *halts.ROUTES,
    (3, "A", 0, "set", ()),
    (3, "A", 0, "draw", (10,)),
)


def _aborts(world: World, host: SimHost) -> None:
    server = cast("AbortingServer", world.server)
    runs = {made.run for made in server.jobs if made.host == host.name and made.state not in FINAL}
    if runs:
        run = host.rng.choice(sorted(runs))
        world.say(f"a person aborts run {run}")
        server.abort(run)


def _stops_device(world: World, host: SimHost) -> None:
    device_id = host.rng.choice(sorted(host.device_ids))
    world.say(f"a person stops a device of {host.name}")
    cast("AbortingServer", world.server).stop_device(host.name, device_id)


WEIGHTS: dict[Step, float] = {**halts.WEIGHTS, _aborts: 0.8, _stops_device: 0.6}
_STEPS = tuple(WEIGHTS)
_CUMULATIVE = tuple(accumulate(WEIGHTS.values()))


def run(seed: int, *, trace: list[str] | None = None, steps: int = STEPS) -> World:
    """Play one schedule and let it come to rest.

    Raises:
        ViolationError: An invariant does not hold.
    """
    world = AbortingWorld(seed, trace=trace)
    halts.submit(world, ROUTES)
    hosts = tuple(world.hosts.values())
    for step in world.rng.choices(_STEPS, cum_weights=_CUMULATIVE, k=steps):
        world.now_s += 0.05
        step(world, hosts[world.rng.getrandbits(1)])
    drain(world)
    for _ in range(4):  # what was taken last is delivered, and told
        schedule.calm_round(world)
    world.check_set()
    world.check_aborted()
    return world
