"""Schedules of hosts whose clocks are a day apart, run at other rates, and are set meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from random import Random
from uuid import UUID

import msgspec

from labweb.domain.messages.events import EdgeEvent, EventsFrame
from labweb.domain.messages.session import Heartbeat, Pulse, Welcome
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_link import host_clocks
from labweb.domain.runs.host_link.host_clocks import Cause, ClockAnchor, Exchange, Happened
from tests.simulation import batches
from tests.simulation.checks import require
from tests.simulation.host import SimHost
from tests.simulation.link import Link
from tests.simulation.memory import MemoryWrite
from tests.simulation.rows import Attempt, Host
from tests.simulation.schedule import Step, drain
from tests.simulation.server import SimServer
from tests.simulation.world import STEPS, World, add_jobs

DAY_S = 86_400.0
ANCHORS = "anchors"
BEGUN_S = 1000.0
"""When the lab was made: nothing happened before it."""

CLOSE_S = 1e-6
"""What numbers of this size are wrong by when they are added."""


class ClockedWrite(MemoryWrite):
    """A write of which an onlooker knows when it really was."""

    truth: dict[str, float]
    now_s: float

    def append(self, kind: str, action_id: UUID | None, body: dict[str, object]) -> None:
        super().append(kind, action_id, body)
        self.truth[self.head[1]] = self.now_s


class ClockedHost(SimHost):
    """A host with a clock that people set, and one that runs a little too fast or too slow."""

    def __init__(self, name: str, lab: ClockedWorld, rng: Random) -> None:
        self.clock_rng = Random(f"clocks {name} {rng.random()}")
        self.ahead_s = self.clock_rng.uniform(-DAY_S, DAY_S)
        self.rate = 1 + self.clock_rng.uniform(-0.9e-4, 0.9e-4)
        self.truth = lab.truth
        self.asked: dict[float, HostMoment] = {}
        super().__init__(name, lab, rng)

    def set_clock(self) -> None:
        """Let a person or a program set the wall clock."""
        self.ahead_s += self.clock_rng.uniform(-DAY_S, DAY_S)

    def moment(self) -> HostMoment:
        now_s = self.lab.now_s
        mono_s = (now_s - self.boot_at_s) * self.rate
        return HostMoment(boot_id=self.boot_id, mono_s=mono_s, wall_s=now_s + self.ahead_s)

    def new_write(self, on_commit: Callable[[bool], None]) -> MemoryWrite:
        made = ClockedWrite(self.disk, self.moment(), on_commit)
        made.truth, made.now_s = self.truth, self.lab.now_s
        return made

    # --- what the server's clock shows ---

    @property
    def anchors(self) -> tuple[ClockAnchor, ...]:
        text = self.disk.meta.get(ANCHORS)
        return () if text is None else msgspec.json.decode(text, type=tuple[ClockAnchor, ...])

    def connect(self) -> Link:
        link = super().connect()
        self.asked = {-1.0: self.moment()}
        return link

    def ask(self) -> None:
        """Send a sign of life that the server answers."""
        if self.link is not None and self.link_epoch is not None:
            at = self.moment()
            self.asked[at.mono_s] = at
            self.link.up.append(_beat(self.link_epoch, at.mono_s))

    def hear(self, frame: object, resumed: Callable[[SimHost], None]) -> None:
        if isinstance(frame, Pulse):
            self._measure(frame.asked_s, frame.heard_at_s, frame.told_at_s)
            return
        if isinstance(frame, Welcome) and frame.heard_at_s is not None:
            self._measure(-1.0, frame.heard_at_s, frame.server_at_s)
        super().hear(frame, resumed)

    def _measure(self, asked_s: float, heard_at_s: float, told_at_s: float) -> None:
        asked = self.asked.pop(asked_s, None)
        if asked is None or asked.boot_id != self.boot_id:
            return
        found = host_clocks.anchor_of(
            Exchange(
                asked=asked,
                heard_at_s=heard_at_s,
                told_at_s=told_at_s,
                got_mono_s=self.moment().mono_s,
            )
        )
        if found is not None:
            kept = host_clocks.with_anchor(self.anchors, found)
            with self.write() as tx:
                tx.set_meta(ANCHORS, msgspec.json.encode(kept).decode())

    def events_after(self, seq: int) -> list[EdgeEvent]:
        return [host_clocks.dated(event, self.anchors) for event in super().events_after(seq)]


def _beat(epoch: int, asked_s: float) -> Heartbeat:
    return Heartbeat(
        epoch=epoch, mono_s=0.0, seq_head=0, stop_latched=False, disk_free_bytes=0, asked_s=asked_s
    )


class ClockedServer(SimServer):
    """A server that dates what hosts tell, as intake does."""

    watch: ClockedWorld
    by_s: dict[str, float]

    def hear(self, link: Link, frame: object) -> None:
        if isinstance(frame, Heartbeat):
            at_s = self.watch.now_s
            if frame.asked_s is not None and link.server_epoch is not None:
                link.down.append(Pulse(asked_s=frame.asked_s, heard_at_s=at_s, told_at_s=at_s))
            return
        super().hear(link, frame)

    def _take_events(self, host: Host, link: Link, frame: EventsFrame) -> None:
        found = host_clocks.latest(frame.events, self.watch.now_s)
        self.by_s = {event.hash: by_s for event, by_s in zip(frame.events, found, strict=True)}
        super()._take_events(host, link, frame)

    def _apply(self, host: Host, event: EdgeEvent) -> None:
        self.watch.date(host, event, self.by_s[event.hash])
        super()._apply(host, event)


class ClockedWorld(World):
    """Two such hosts, and an onlooker who knows when everything happened."""

    def __init__(self, seed: int, *, trace: list[str] | None = None) -> None:
        self.truth: dict[str, float] = {}
        self.last: dict[str, Happened] = {}
        self.sent_s: dict[UUID, float] = {}
        super().__init__(seed, trace=trace)

    def make_server(self) -> SimServer:
        return ClockedServer(self)

    def make_host(self, name: str, rng: Random) -> SimHost:
        return ClockedHost(name, self, rng)

    def dispatched(self, attempt: Attempt) -> None:
        self.sent_s[attempt.id] = self.now_s
        super().dispatched(attempt)

    def date(self, host: Host, event: EdgeEvent, by_s: float) -> None:
        """Date an event as the server does, and judge that: T1 to T4."""
        last = self.last.get(host.name)
        sent_s = None if event.action_id is None else self.sent_s.get(event.action_id)
        causes = [Cause(BEGUN_S) if last is None else Cause(last.at_s, last.uncertainty_s)]
        causes += [] if sent_s is None else [Cause(sent_s)]
        found = host_clocks.happened(host_clocks.told_moment(event), causes, by_s)
        name = f"event {event.seq} of {host.name}, {event.kind}"
        for cause in causes:
            text = f"{name} at {found.at_s} is before its cause at {cause.at_s}"
            require(found.at_s >= cause.at_s, "T1", text)
        text = f"{name} at {found.at_s} is after its reception at {self.now_s}"
        require(found.at_s <= self.now_s, "T2", text)
        wrong_s = abs(self.truth[event.hash] - found.at_s)
        text = f"{name} is wrong by {wrong_s} s and says {found.uncertainty_s} s"
        require(wrong_s <= found.uncertainty_s + CLOSE_S, "T3", text)
        self.last[host.name] = found
        if event.uncertainty_s is not None:
            text = f"{name} was measured, and is known to {found.uncertainty_s} s"
            # Twice: the middle moves where an end of the span is cut off.
            is_close = found.uncertainty_s <= 2 * event.uncertainty_s + CLOSE_S
            is_moved = any(found.at_s == cause.at_s for cause in causes)
            require(not found.is_bounded and (is_close or is_moved), "T4", text)


def _sets_clock(world: World, host: SimHost) -> None:
    if isinstance(host, ClockedHost):
        host.set_clock()
        world.say(f"the clock of {host.name} is set: {host.ahead_s:+.0f} s")


def _asks(world: World, host: SimHost) -> None:
    if isinstance(host, ClockedHost) and host.is_up:
        host.ask()


def _long_night(world: World, host: SimHost) -> None:
    """The server is away for hours, and what was taken in batches goes on."""
    world.is_cut_off[host.name].update(("uplink", "broker"))
    world.say(f"{host.name} is cut off for long")
    for _ in range(6):
        world.pass_time(host.rng.uniform(60.0, 4000.0))
        world.step_line(host)


WEIGHTS: dict[Step, float] = {
    **batches.WEIGHTS,
    _sets_clock: 1.0,
    _asks: 6.0,
    _long_night: 0.2,
}
_STEPS = tuple(WEIGHTS)
_CUMULATIVE = tuple(accumulate(WEIGHTS.values()))


def run(seed: int, *, trace: list[str] | None = None, steps: int = STEPS) -> World:
    """Play one schedule and let it come to rest.

    Raises:
        ViolationError: An invariant does not hold.
    """
    world = ClockedWorld(seed, trace=trace)
    choice = Random(f"policies {seed}")
    add_jobs(world, batches.ROUTES, {run: choice.choice(batches.POLICIES) for run in (0, 1)})
    hosts = tuple(world.hosts.values())
    for step in world.rng.choices(_STEPS, cum_weights=_CUMULATIVE, k=steps):
        world.now_s += 0.05
        step(world, hosts[world.rng.getrandbits(1)])
    drain(world)
    return world
