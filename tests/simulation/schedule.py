"""Which step comes next: ordinary work, and every fault that the protocol names."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate

from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import AT_EDGE, FINAL, JobState
from tests.simulation import checks
from tests.simulation.host import SimHost
from tests.simulation.rows import Host, Job
from tests.simulation.world import DRAIN_ROUNDS, STEPS, World, add_jobs

Step = Callable[[World, SimHost], None]


def _exchanges(world: World, host: SimHost) -> None:
    """Let the uplink do a little of everything."""
    world.step_uplink(host)
    world.step_up(host)
    world.step_down(host)


def _broker_repeats(world: World, host: SimHost) -> None:
    waiting = world.brokers[host.name]
    if waiting:
        waiting.append(waiting[host.rng.randrange(len(waiting))])


def _broker_drops(world: World, host: SimHost) -> None:
    waiting = world.brokers[host.name]
    if waiting:
        del waiting[host.rng.randrange(len(waiting))]


def _broker_purged(world: World, host: SimHost) -> None:
    world.brokers[host.name].clear()


def _waits(world: World, host: SimHost) -> None:
    world.pass_time(host.rng.uniform(1.0, 12.0))


def _cancels(world: World, host: SimHost) -> None:
    found = [job for job in world.server.jobs if job.host == host.name and job.state not in FINAL]
    sent = [job for job in found if job.state in AT_EDGE] or found
    if sent:
        job = host.rng.choice(sent)
        world.say(f"a person cancels job {job.index}")
        world.server.cancel(job)


def _answers(world: World, host: SimHost) -> None:
    for job in world.server.jobs:
        if job.host == host.name and job.state is JobState.IN_DOUBT:
            world.answer(job, host.rng)
    world.take_stock()


def _sets_aside(world: World, host: SimHost) -> None:
    world.set_aside(host)


def _cut_off(world: World, host: SimHost) -> None:
    kinds = host.rng.choice((("uplink",), ("broker",), ("uplink", "broker")))
    world.say(f"{host.name} is cut off: {' '.join(kinds)}")
    world.is_cut_off[host.name].update(kinds)


def _healed(world: World, host: SimHost) -> None:
    world.is_cut_off[host.name].clear()


def _line_killed(world: World, host: SimHost) -> None:
    if host.line is not None:
        world.say(f"{host.name}: the line is killed at: {host.where}")
        world.interrupted(host)
        host.kill_line()


def _uplink_killed(world: World, host: SimHost) -> None:
    host.kill_uplink()


def _host_killed(world: World, host: SimHost) -> None:
    world.say(f"{host.name} is killed at: {host.where}")
    world.kill_host(host)


def _host_rebooted(world: World, host: SimHost) -> None:
    world.say(f"{host.name} is rebooted at: {host.where}")
    world.kill_host(host)
    world.guarded(host, lambda: host.start(is_cold=True))


def _killed_before_seal(world: World, host: SimHost) -> None:
    host.dies_before_seal = True


def _server_restarts(world: World, host: SimHost) -> None:
    world.restart_server()


def _link_cut(world: World, host: SimHost) -> None:
    if host.link is not None:
        world.say(f"the connection of {host.name} breaks")
        world.cut(host.link)


def _frame_lost(world: World, host: SimHost) -> None:
    link = host.link
    if link is not None and (link.up or link.down):
        if host.rng.getrandbits(1):
            world.step_up(host)
        else:
            world.step_down(host)
        lost = " ".join(type(frame).__name__ for frame in (*link.up, *link.down))
        world.say(f"{host.name}: the connection breaks; lost: {lost}")
        world.cut(link)


def _copied(world: World, host: SimHost) -> None:
    if host.seal is not None:
        host.copies.append((host.disk.copy(), host.seal))
        del host.copies[:-3]


def _put_back(world: World, host: SimHost) -> None:
    world.put_back(host)


def _put_back_whole(world: World, host: SimHost) -> None:
    world.put_back_whole(host)


def _row_lost(world: World, host: SimHost) -> None:
    acked = world.server.host(host.name).record.acked_seq
    head = host.disk.head[0]
    if head > acked + 1:
        world.say(f"{host.name}: the disk loses event {acked + 1}")
        host.lost_rows.add((host.disk.journal_id, acked + 1))


WEIGHTS: dict[Step, float] = {
    lambda world, host: world.step_line(host): 40,
    _exchanges: 30,
    lambda world, host: world.step_broker(host): 14,
    lambda world, host: world.step_uplink(host): 4,
    lambda world, host: world.step_up(host): 6,
    lambda world, host: world.step_down(host): 6,
    lambda world, host: world.server.tick(): 8,
    _waits: 3,
    _broker_repeats: 2,
    _broker_drops: 1,
    _broker_purged: 0.2,
    _cancels: 0.5,
    _answers: 2,
    _sets_aside: 0.6,
    _cut_off: 0.8,
    _healed: 2,
    _line_killed: 0.8,
    _uplink_killed: 0.3,
    _host_killed: 0.5,
    _host_rebooted: 0.4,
    _killed_before_seal: 0.2,
    _server_restarts: 0.3,
    _link_cut: 0.6,
    _frame_lost: 0.6,
    _copied: 1.2,
    _put_back: 0.25,
    _put_back_whole: 0.1,
    _row_lost: 0.05,
}
STEPS_OF_A_SCHEDULE = tuple(WEIGHTS)
CUMULATIVE = tuple(accumulate(WEIGHTS.values()))


def run(seed: int, *, trace: list[str] | None = None, steps: int = STEPS) -> World:
    """Play one schedule and let it come to rest.

    Raises:
        ViolationError: An invariant does not hold.
    """
    world = World(seed, trace=trace)
    add_jobs(world)
    hosts = tuple(world.hosts.values())
    rng = world.rng
    chosen = rng.choices(STEPS_OF_A_SCHEDULE, cum_weights=CUMULATIVE, k=steps)
    for step in chosen:
        world.now_s += 0.05
        step(world, hosts[rng.getrandbits(1)])
    drain(world)
    return world


def drain(world: World) -> None:
    """Let faults end and people answer, until nothing is left to do; then look at it all."""
    world.is_calm = True
    for host in world.hosts.values():
        host.dies_before_seal = False
        host.is_lost = False
        host.lost_rows = {one for one in host.lost_rows if one[0] == host.disk.journal_id}
        world.is_cut_off[host.name].clear()
    for _ in range(DRAIN_ROUNDS):
        if _is_over(world):
            break
        calm_round(world)
    checks.check_quiet(world)


def _is_over(world: World) -> bool:
    server = world.server
    if any(job.state not in FINAL for job in server.jobs):
        return False
    if any(vessel.quarantined_by is not None for vessel in server.vessels.values()):
        return False
    return all(_is_at_rest(server.host(host.name), host) for host in world.hosts.values())


def _is_at_rest(known: Host, host: SimHost) -> bool:
    return (
        known.state is SessionState.ONLINE
        and host.link_epoch == known.record.epoch
        and known.record.acked_seq == host.disk.head[0]
        and all(row.is_answered for row in known.outbox)
    )


def calm_round(world: World) -> None:
    """Let each part do what is open once, with nothing that disturbs it."""
    world.pass_time(2.1)
    world.server.tick()
    for host in world.hosts.values():
        world.set_aside(host)
        world.settle(host)
        if host.link is not None and host.link.is_cut:
            host.kill_uplink()
        _talk(world, host)
        while world.brokers[host.name] and host.is_up:
            world.step_broker(host)
        for _ in range(16):
            world.step_line(host)
            if host.where == "idle":
                break
        _talk(world, host)
    for job in world.server.jobs:
        if job.state is JobState.IN_DOUBT:
            world.answer(job, world.rng)
        elif job.state is JobState.HELD or _is_behind_an_end(world, job):
            world.server.cancel(job)
    world.take_stock()


def _talk(world: World, host: SimHost) -> None:
    for _ in range(6):
        world.step_uplink(host)
        link = host.link
        if link is None or not (link.up or link.down) or not host.is_up:
            return
        world.step_up(host)
        world.step_down(host)


def _is_behind_an_end(world: World, job: Job) -> bool:
    """Say whether a person has to give a job up, because one before it did not complete."""
    if job.state not in {JobState.QUEUED, JobState.SUSPENDED}:
        return False
    ended = [world.server.by_index[index].state for index in job.after]
    return any(state in FINAL and state is not JobState.COMPLETE for state in ended)
