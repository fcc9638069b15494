"""Schedules by hand, for what random ones meet too rarely."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from random import Random
from uuid import UUID

import msgspec

from labweb.domain.messages import Command, Do, Reset, Signed, StopLab
from labweb.domain.runs import standing
from labweb.domain.runs.job import JobState
from labweb.domain.runs.journal import HeldResource
from labweb.domain.runs.session import SessionState
from tests.simulation.checks import require
from tests.simulation.host import SimHost
from tests.simulation.rows import Policy
from tests.simulation.schedule import drain
from tests.simulation.world import World, add_jobs

Schedule = Callable[[], None]


def a_world() -> World:
    """Return a lab whose hosts have a session, before anything was dispatched."""
    world = World(0)
    world.is_calm = True
    add_jobs(world)
    for host in world.hosts.values():
        talk(world, host)
        assert world.server.host(host.name).state is SessionState.ONLINE
    return world


def talk(world: World, host: SimHost) -> None:
    """Let uplink and server say all they have to say."""
    for _ in range(8):
        world.step_uplink(host)
        world.step_up(host)
        world.step_down(host)


def take_all(world: World, host: SimHost) -> None:
    """Deliver all that waits in the broker."""
    while world.brokers[host.name]:
        world.step_broker(host)


def work(world: World, host: SimHost, until: str = "idle") -> None:
    """Let the line work up to a place."""
    for _ in range(40):
        world.step_line(host)
        if host.where == until:
            return


def dispatched(world: World) -> SimHost:
    """Dispatch the first jobs, and return host A, to which they were sent."""
    world.server.tick()
    return world.hosts["A"]


def restored(world: World, host: SimHost) -> None:
    """Put the journal of a host back to its newest copy, its seal as it was."""
    host.copies = host.copies[-1:]
    world.put_back(host)


def copied(host: SimHost) -> None:
    """Copy a host's journal."""
    assert host.seal is not None
    host.copies.append((host.disk.copy(), host.seal))


def signed(command: Command) -> tuple[Signed, Command]:
    """Return a command as it travels."""
    return Signed(body=msgspec.json.encode(command).decode(), key_id="k", signature=""), command


def grown(world: World, host: SimHost) -> None:
    """Let a journal grow by commands that it refuses, each with an event."""
    command = next(row.command for row in world.server.host(host.name).outbox)
    assert isinstance(command, Do)
    for number in range(8):
        odd = msgspec.structs.replace(
            command, epoch=host.disk.epoch, dseq=90 + number, action_id=UUID(int=number), v=99
        )
        host.take(*signed(odd))


# --- schedules ---


def restored_and_outgrown() -> None:
    """A journal loses what was never uploaded, and grows past its seal before any HELLO.

    accept ─▶ copy ─▶ act ─▶ put back ─▶ other commands come from the broker ─▶ session
    """
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    talk(world, host)
    copied(host)
    world.is_cut_off["A"].add("uplink")
    work(world, host)
    restored(world, host)
    world.step_line(host)
    grown(world, host)
    world.is_cut_off["A"].clear()
    host.kill_uplink()
    talk(world, host)
    work(world, host)
    drain(world)


def whole_disk_restored_and_outgrown() -> None:
    """Journal and seal are put back together, and grow past what the server has read.

    accept ─▶ copy ─▶ act, upload ─▶ put both back, reboot ─▶ other commands ─▶ session
    """
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    copied(host)
    work(world, host)
    talk(world, host)
    world.put_back_whole(host)
    grown(world, host)
    world.step_uplink(host)
    for _ in range(3):
        world.step_up(host)
        world.step_down(host)
        world.step_down(host)
    work(world, host)
    drain(world)


def journal_of_before_the_reset() -> None:
    """A copy of the journal that was set aside is put back under its successor's seal."""
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    copied(host)
    host.lost_rows.add((host.disk.journal_id, 3))
    talk(world, host)
    world.server.quarantine(world.server.host("A"), "host.gap")
    world.set_aside(host)
    world.is_cut_off["A"].add("uplink")
    restored(world, host)
    work(world, host)
    work(world, host)
    world.is_cut_off["A"].clear()
    drain(world)


def same_length_other_history() -> None:
    """A journal is put back and grows to exactly the length that its seal names."""
    world = a_world()
    host = dispatched(world)
    talk(world, host)
    take_all(world, host)
    talk(world, host)
    copied(host)
    world.is_cut_off["A"].add("uplink")
    length = len(host.disk.events)
    work(world, host, "acting")
    assert len(host.disk.events) == length + 1
    restored(world, host)
    world.kill_host(host)
    world.now_s += 5.0
    command = world.server.host("A").outbox[0].command
    assert isinstance(command, Do)
    odd = msgspec.structs.replace(command, epoch=host.disk.epoch, dseq=99, action_id=host.id, v=99)
    host.is_up = True
    host.line = None
    host.take(*signed(odd))
    host.kill()
    work(world, host)
    work(world, host)
    world.is_cut_off["A"].clear()
    drain(world)


def answered_before_stock() -> None:
    """A person answers for a fenced action while its host, out of reach, still holds it."""
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    talk(world, host)
    world.is_cut_off["A"].add("uplink")
    known = world.server.host("A")
    host.lost_rows.add((host.disk.journal_id, 99))
    world.server.quarantine(known, "host.gap")
    for job in world.server.jobs:
        if job.state is JobState.IN_DOUBT:
            world.answer(job, world.rng)
    work(world, host)
    world.is_cut_off["A"].clear()
    drain(world)


def later_before_earlier() -> None:
    """A host is given the second dispatch of a device first, and then the first."""
    world = a_world()
    host = dispatched(world)
    first = world.server.host("A").outbox[0].command
    assert isinstance(first, Do)
    attempt = world.server.attempts[first.action_id]
    second = msgspec.structs.replace(first, dseq=50, action_id=host.id, resources=[])
    world.server.attempts[host.id] = attempt
    host.take(*signed(second))
    host.disk.resources.update(_adopted(first))
    work(world, host)
    host.take(*signed(msgspec.structs.replace(first, resources=[])))
    work(world, host)


def next_on_a_doubtful_device() -> None:
    """A device whose action is in doubt has another one waiting."""
    world = a_world()
    host = dispatched(world)
    first = world.server.host("A").outbox[0].command
    assert isinstance(first, Do)
    host.take(*signed(first))
    second = msgspec.structs.replace(first, dseq=50, action_id=host.id)
    world.server.attempts[host.id] = world.server.attempts[first.action_id]
    host.take(*signed(second))
    work(world, host, "acting")
    world.interrupted(host)
    host.kill_line()
    work(world, host, "recovered")
    host.disk.resources.update(_adopted(first))
    work(world, host)


def below_the_floor() -> None:
    """What was accepted and then given up waits in the journal when the host is armed."""
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    with host.write() as tx:
        tx.set_meta("floor", "90")
    work(world, host)


def measured_after_discard() -> None:
    """A person gives an action up, measures its vessels, and the next job uses them."""
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    talk(world, host)
    work(world, host, "acting")
    world.interrupted(host)
    host.kill_line()
    work(world, host)
    talk(world, host)
    job = next(one for one in world.server.jobs if one.state is JobState.IN_DOUBT)
    world.server.resolve(job, "discard", None)
    world.server.tick()
    take_all(world, host)
    talk(world, host)
    assert job.state is JobState.ABORTED
    world.take_stock()
    drain(world)
    last = next(one for one in world.server.jobs if one.index == 2)
    require(last.state is JobState.COMPLETE, "I8", "the device stays closed for the next job")


def stopped_and_reset() -> None:
    """A lab is stopped; restart, session and another stop's reset start nothing, its own does."""
    world = a_world()
    host = dispatched(world)
    take_all(world, host)
    with host.write() as tx:
        standing.write_stop(tx, StopLab(stop_id=UUID(int=7), issued_by="ada"))
    work(world, host)
    world.kill_host(host)
    host.start(is_cold=False)
    talk(world, host)
    for number in (6, 7):
        require(not world.matter.count, "I14", "something moved while the lab is stopped")
        host.take(*signed(_reset(host, number)))
        work(world, host)
    require(world.matter.count, "I8", "nothing moves after the reset")
    drain(world)


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


def _reset(host: SimHost, number: int) -> Reset:
    return Reset(
        host_id=host.id, epoch=host.disk.epoch, dseq=1, stop_id=UUID(int=number), reason="clear"
    )


def _adopted(do: Do) -> dict[UUID, HeldResource]:
    return {view.id: HeldResource(view=view) for view in do.resources}


SCHEDULES: tuple[Schedule, ...] = (
    restored_and_outgrown,
    whole_disk_restored_and_outgrown,
    journal_of_before_the_reset,
    same_length_other_history,
    answered_before_stock,
    later_before_earlier,
    next_on_a_doubtful_device,
    below_the_floor,
    measured_after_discard,
    stopped_and_reset,
    told_and_taken_back,
    two_machines,
    two_machines_in_turn,
    spoken_before,
    fenced_by_two,
    absence_put_back,
)
