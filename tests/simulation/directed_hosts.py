"""Schedules by hand about hosts that are copied, lost, or put back while they work alone."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from labweb.domain.runs.states.job_states import JobState
from tests.simulation.checks import require
from tests.simulation.directed import (
    Schedule,
    a_world,
    copied,
    dispatched,
    restored,
    take_all,
    talk,
    work,
)
from tests.simulation.host import SimHost
from tests.simulation.rows import Policy
from tests.simulation.schedule import drain
from tests.simulation.world import World, add_jobs


def told_and_taken_back() -> None:
    """A host dies between the write of a cancel and its seal, tells of it, and is put back.

    accept ─▶ uplink away ─▶ copy ─▶ cancel, dies before the seal ─▶ session tells ─▶ put back
    """
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    talk(world, host)
    host.kill_uplink()
    host.lose_link()
    copied(host)
    world.server.cancel(world.server.jobs[0])
    world.server.tick()
    host.dies_before_seal = True
    world.step_broker(host)
    require(not host.is_up, "I8", "the host survived its death")
    world.step_line(host)
    talk(world, host)
    restored(world, host)
    work(world, host)
    work(world, host)
    drain(world)


def two_machines() -> None:
    """A machine is copied whole, and both speak with one identity."""
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    host.instance = "one"
    host.kill_uplink()
    talk(world, host)
    twin = SimHost("A", world, Random(7))
    twin.disk, twin.seal = host.disk.copy(), host.seal
    twin.instance, twin.boot_count, twin.is_up = "two", 40, True
    world.server.hear(twin.connect(), twin.hello())
    known = world.server.host("A")
    require(known.live_instance == "one", "I1", "a second machine was let in beside the first")
    drain(world)


def two_machines_in_turn() -> None:
    """A copy of the machine has a session and says nothing; then the first one comes back."""
    world = a_world()
    host = world.hosts["A"]
    twin = SimHost("A", world, Random(7))
    twin.disk, twin.seal = host.disk.copy(), host.seal
    twin.boot_count, twin.is_up = 40, True
    world.server.open_session(twin.connect(), twin.hello())
    host.is_put_back = host.was_put_back = True
    host.kill_uplink()
    world.step_uplink(host)
    world.step_up(host)
    known = world.server.host("A")
    require(bool(known.record.quarantine), "I13", "two machines speak with one identity")
    drain(world)


def spoken_before() -> None:
    """A copy from before a session connects after the host has spoken in that session."""
    world = a_world()
    host = world.hosts["A"]
    copy, seal = host.disk.copy(), host.seal
    host.kill_uplink()
    talk(world, host)
    world.pass_time(1.0)
    world.server.host("A").record = replace(
        world.server.host("A").record, acked_seq=copy.head[0], hash_at_acked=copy.head[1]
    )
    host.disk, host.seal = copy, seal
    host.is_put_back = host.was_put_back = True
    host.kill_uplink()
    world.step_uplink(host)
    world.step_up(host)
    known = world.server.host("A")
    require(bool(known.record.quarantine), "I13", "a journal from before a session was let in")


def fenced_by_two() -> None:
    """A machine is lost with an action under way; two people fence it, and answer for it."""
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    talk(world, host)
    work(world, host, "acting")
    talk(world, host)
    world.kill_host(host)
    host.is_lost = True
    world.server.sign_fence("A", "ada")
    require(not world.server.host("A").record.quarantine, "I16", "one person fenced a live host")
    world.pass_time(40.0)
    world.server.sign_fence("A", "ada")
    world.server.sign_fence("A", "ada")
    require(not world.server.host("A").record.quarantine, "I16", "one person fenced alone")
    world.server.sign_fence("A", "bob")
    for job in world.server.jobs:
        if job.state is JobState.IN_DOUBT:
            world.answer(job, world.rng)
            require(job.state is not JobState.IN_DOUBT, "I8", "it waits for a host that is lost")
    drain(world)


def absence_put_back() -> None:
    """The server is away for longer than the batch may go on; then the disk is put back.

    accept ─▶ copy ─▶ server away ─▶ 30 s ─▶ put back ─▶ the line starts
    """
    world = World(0)
    world.is_calm = True
    add_jobs(world, policies={0: Policy("continue", 8.0), 1: Policy("continue", 8.0)})
    for host in world.hosts.values():
        talk(world, host)
    host = dispatched(world)
    take_all(world, host)
    talk(world, host)
    copied(host)
    host.kill_uplink()
    host.lose_link()
    world.is_cut_off["A"].add("uplink")
    world.now_s += 30.0
    restored(world, host)
    work(world, host)
    work(world, host)
    world.is_cut_off["A"].clear()
    drain(world)


def absence_put_back_unsealed() -> None:
    """The same, but the host died before it had sealed that the server was away.

    accept ─▶ copy ─▶ server away, dies before the seal ─▶ starts ─▶ 30 s ─▶ put back ─▶ the line
    """
    world = World(0)
    world.is_calm = True
    add_jobs(world, policies={0: Policy("continue", 8.0), 1: Policy("continue", 8.0)})
    for host in world.hosts.values():
        talk(world, host)
    host = dispatched(world)
    take_all(world, host)
    talk(world, host)
    copied(host)
    host.kill_uplink()
    host.dies_before_seal = True
    world.guarded(host, host.lose_link)
    world.guarded(host, lambda: host.start(is_cold=False))
    world.is_cut_off["A"].add("uplink")
    world.now_s += 30.0
    restored(world, host)
    work(world, host)
    work(world, host)
    world.is_cut_off["A"].clear()
    drain(world)


SCHEDULES: tuple[Schedule, ...] = (
    told_and_taken_back,
    two_machines,
    two_machines_in_turn,
    spoken_before,
    fenced_by_two,
    absence_put_back,
    absence_put_back_unsealed,
)
