"""Schedules in which devices lose their set-points by themselves, beside all that halts do.

The runs are those of `tests.simulation.halts`. A device restarts at any moment, also in the middle
of an action of another device of its host; its host refreshes what stands there, and looks, each
when its turn comes.
"""

from __future__ import annotations

from collections.abc import Generator
from itertools import accumulate
from random import Random
from typing import cast
from uuid import UUID

import msgspec

from labweb.domain.crutd.operations import Update
from labweb.domain.enrollment.setpoint_readback import KeptReading, ReadbackVerdict
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.halts import standing_setpoints, vanished_setpoints
from labweb.domain.runs.halts.standing_setpoints import StandingSetpoint
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from labweb.domain.runs.states.job_states import JobState
from tests.simulation import halts
from tests.simulation.checks import require
from tests.simulation.halting import (
    PUMP_OF,
    SETPOINT,
    HaltingHost,
    HaltingServer,
    HaltingWorld,
    _config,
)
from tests.simulation.host import SimHost
from tests.simulation.rows import Host
from tests.simulation.schedule import Step, calm_round, drain
from tests.simulation.server import SimServer
from tests.simulation.world import STEPS, World

Known = dict[UUID, dict[str, StandingSetpoint]]


class VanishingServer(HaltingServer):
    """Takes in what hosts tell of losses, as the services do on the rows of the database."""

    def _take_word(self, host: Host, event: EdgeEvent) -> None:
        super()._take_word(host, event)
        if event.kind != vanished_setpoints.EVENT:
            return
        body = event.body
        attempt = self.attempts[UUID(body["action_id"])]
        job = attempt.job
        is_last = job.actions[-1].id == attempt.id
        if is_last and job.state is JobState.COMPLETE:
            job.halted_by = job.halted_by or body["code"]
        syringe_id = PUMP_OF[UUID(body["device_id"])].syringe
        vessel = self.vessels[syringe_id]
        gone = vanished_setpoints.gone_of(vessel.view.data, body["action"])
        told = body["data"].get(str(syringe_id))
        if told is not None and told != gone:
            self.tickets.append("reconcile.drift")
        vessel.view = msgspec.structs.replace(vessel.view, data={**vessel.view.data, **gone})
        if gone or told:
            told_rev = body["revs"].get(str(syringe_id), 0)
            self._set_revs({str(syringe_id): max(vessel.view.rev + 1, told_rev)})


class VanishingHost(HaltingHost):
    """Watches what stands on its devices, by readings that may be older than the journal."""

    def new_journal(self) -> None:
        super().new_journal()
        self.known: Known = {}

    def _forget(self) -> None:
        super()._forget()
        self.is_sampling = False

    def start(self, *, is_cold: bool) -> None:
        self.is_sampling = False
        super().start(is_cold=is_cold)

    def _step(self) -> Generator[str, None, bool]:
        """Take readings from here on, as a line does once it has halted what it was left with."""
        self.is_sampling = True
        return (yield from super()._step())

    def refresh(self) -> None:
        """Read in the journal what stands."""
        self.known = standing_setpoints.read_stands(self.disk.meta)

    def look(self) -> None:
        """Compare what stands with what its devices are set to."""
        lab = cast("VanishingWorld", self.pumping)
        if not self.is_sampling:
            return
        for device_id, of_device in sorted(self.known.items()):
            for one in of_device.values():
                asked, found = lab.asked_by(self, one), lab.set_to.get(device_id)
                if found != asked:
                    self._tell(lab, device_id, one, asked, found)

    def _tell(
        self,
        lab: VanishingWorld,
        device_id: UUID,
        one: StandingSetpoint,
        asked: float,
        found: float | None,
    ) -> None:
        kept = KeptReading(status=SETPOINT, sort=ReadbackVerdict.SETPOINT, asked=asked)
        device = _config(PUMP_OF[device_id])
        with self.write() as tx:
            is_told = vanished_setpoints.write_vanished(tx, device, one, kept, found or 0.0)
        if is_told:
            lab.check_told(device_id, one.action_id)


class VanishingWorld(HaltingWorld):
    """Knows which set-points were really lost, and whether each was told, once."""

    def __init__(self, seed: int, *, trace: list[str] | None = None) -> None:
        self.set_by: dict[UUID, UUID] = {}
        """The action that has set a device last."""

        self.lost: set[UUID] = set()
        """Actions whose device has lost what they had set."""

        self.told: set[UUID] = set()
        self.unseen: set[UUID] = set()
        """Devices that have lost something since their host looked last."""

        super().__init__(seed, trace=trace)

    def make_server(self) -> SimServer:
        return VanishingServer(self)

    def make_host(self, name: str, rng: Random) -> SimHost:
        return VanishingHost(name, self, rng)

    def asked_by(self, host: SimHost, one: StandingSetpoint) -> float:
        """Return what an action was to set."""
        operation = host.disk.actions[one.action_id].operation
        return float(cast("Update", operation).data[SETPOINT])

    def _turn(self, row: ActionRow) -> None:
        super()._turn(row)
        self.set_by[row.device_id] = row.action_id
        self.unseen.discard(row.device_id)

    def restart_device(self, device_id: UUID) -> None:
        """Let a device come up again, with nothing set."""
        if self.set_to.get(device_id) is None:
            return
        self.say(f"device {device_id} restarts")
        self.set_to[device_id] = None
        self.lost.add(self.set_by[device_id])
        self.unseen.add(device_id)

    def settle(self, host: SimHost) -> None:
        super().settle(host)
        assert isinstance(host, VanishingHost)
        if host.is_up and host.line is not None:
            self.look(host)

    def look(self, host: VanishingHost) -> None:
        """Let a host look after what stands."""
        self.guarded(host, host.refresh)
        self.guarded(host, host.look)

    # --- what must hold ---

    def check_told(self, device_id: UUID, action_id: UUID) -> None:
        """V1, V2: what is told as lost is lost, or nobody knew what is set, and is told once."""
        text = f"action {action_id} is told as lost, and its device has lost nothing of it"
        require(action_id in self.lost or device_id in self.unknown, "V1", text)
        require(action_id not in self.told, "V2", f"the loss of {action_id} is told twice")
        self.told.add(action_id)

    def _check_record(self, device_id: UUID, known: object, who: str) -> None:
        if device_id not in self.unseen:  # a loss that nobody has looked at yet
            super()._check_record(device_id, known, who)

    def check_lost(self) -> None:
        """H2, H3, once everybody has looked: no loss is left unseen."""
        self.unseen.clear()
        self.check_set()


def _restarts(world: World, host: SimHost) -> None:
    device_id = host.rng.choice(sorted(host.device_ids))
    cast("VanishingWorld", world).restart_device(device_id)


def _refreshes(world: World, host: SimHost) -> None:
    if host.is_up and host.line is not None:
        world.guarded(host, cast("VanishingHost", host).refresh)


def _looks(world: World, host: SimHost) -> None:
    if host.is_up and host.line is not None:
        world.guarded(host, cast("VanishingHost", host).look)


WEIGHTS: dict[Step, float] = {
    **halts.WEIGHTS,
    _restarts: 3.0,
    _refreshes: 8.0,
    _looks: 8.0,
}
_STEPS = tuple(WEIGHTS)
_CUMULATIVE = tuple(accumulate(WEIGHTS.values()))


def run(seed: int, *, trace: list[str] | None = None, steps: int = STEPS) -> World:
    """Play one schedule and let it come to rest.

    Raises:
        ViolationError: An invariant does not hold.
    """
    world = VanishingWorld(seed, trace=trace)
    halts.submit(world)
    hosts = tuple(world.hosts.values())
    for step in world.rng.choices(_STEPS, cum_weights=_CUMULATIVE, k=steps):
        world.now_s += 0.05
        step(world, hosts[world.rng.getrandbits(1)])
    drain(world)
    calm_round(world)  # a line that came up in the last round looks now
    world.check_lost()
    return world
