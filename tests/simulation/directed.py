"""Schedules by hand, for what random ones meet too rarely."""

from __future__ import annotations

from collections.abc import Callable
from uuid import UUID

import msgspec

from labweb.domain.messages.commands import Command, Do, Reset
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.host_actions import host_state
from labweb.domain.runs.host_journal.journal_rows import HeldResource
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import JobState
from tests.simulation.checks import require
from tests.simulation.host import SimHost
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
        host_state.write_stop(tx, StopLabFrame(stop_id=UUID(int=7), issued_by="ada"))
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
)
