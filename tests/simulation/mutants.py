"""The protocol with one rule removed: each must be found out by the checks.

A mutant replaces a rule for as long as a schedule is played. `test_mutants.py` pins one that
kills it: a seed, or a schedule by hand where random ones meet it too rarely.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import msgspec
import pytest

from labweb.domain.messages.events import EdgeEvent
from labweb.domain.messages.session import Hello
from labweb.domain.runs.exclusive_use import action_locks
from labweb.domain.runs.host_actions import action_execution, host_state
from labweb.domain.runs.host_journal import action_states
from labweb.domain.runs.host_journal.action_states import ActionState, HostAnswer, HostState
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from labweb.domain.runs.host_link import host_session
from labweb.domain.runs.host_link.host_session import HelloAnswer, HostRecord, Intake, SessionState
from labweb.domain.runs.states.job_states import AT_EDGE, STEPS, JobState, Mover
from tests.simulation import host as sim_host
from tests.simulation import server as sim_server
from tests.simulation.host import SimHost
from tests.simulation.memory import MemoryWrite

Patch = pytest.MonkeyPatch
Mutant = Callable[[Patch], None]


def no_dedupe(patch: Patch) -> None:
    """A command that comes again is taken again."""
    real = action_states.decide_accept

    def decide(host: HostState, **known: Any) -> HostAnswer:  # noqa: ANN401 - as the rule
        return real(host, **{**known, "known": None})

    def insert(self: MemoryWrite, row: ActionRow) -> None:
        self._put(self._disk.actions, row.action_id, row)

    patch.setattr(action_states, "decide_accept", decide)
    patch.setattr(MemoryWrite, "insert_action", insert)


def locks_off(patch: Patch) -> None:
    """Nothing is ever in use."""
    patch.setattr(action_locks, "conflicts", lambda wanted, held: [])


def started_after_acting(patch: Patch) -> None:
    """The start is written when the device has answered."""

    def attempt(self: SimHost, row: ActionRow) -> Generator[str, None, bool]:
        started = action_execution.Started(row, row.do)
        if self.is_held(row):
            return False
        yield "before started"
        self.lab.begin(self, started)
        self.acting = started
        yield "acting"
        report = self.lab.finish(self, started)
        self.acting = None
        with self.write() as tx:
            action_execution.start(tx, row, row.do, at=self.moment(), scene=sim_host.SCENE)
        yield "before actuated"
        with self.write() as tx:
            action_execution.write_end(tx, row, report, [])
        return True

    patch.setattr(SimHost, "_try", attempt)


def retry_after_crash(patch: Patch) -> None:
    """What was started and not answered is begun again."""

    def recover(tx: MemoryWrite, row: ActionRow) -> bool:
        if tx.state_of(row.action_id) is ActionState.STARTED:
            tx._put(tx._disk.actions, row.action_id, replace(row, st=ActionState.ACCEPTED))
            tx._disk.fences.pop(row.device_id, None)
        return False

    patch.setattr(action_execution, "recover", recover)


def no_epoch_check(patch: Patch) -> None:
    """A command of an older session counts."""
    real = action_states.decide_accept

    def decide(host: HostState, **known: Any) -> HostAnswer:  # noqa: ANN401 - as the rule
        return real(host, **{**known, "epoch": host.epoch})

    patch.setattr(action_states, "decide_accept", decide)


def ignore_regression(patch: Patch) -> None:
    """A journal that went back in time is as good as any."""
    patch.setattr(sim_host, "find_regression", lambda chain, seal: None)
    patch.setattr(sim_host, "is_raised", lambda found, wanted, hash_at_found: True)

    def decide(record: HostRecord, hello: Hello, **_: object) -> HelloAnswer:
        return HelloAnswer("normal")

    patch.setattr(host_session, "decide_hello", decide)


def accept_gaps(patch: Patch) -> None:
    """Events are applied though one before them is missing."""

    def check(record: HostRecord, events: Sequence[EdgeEvent]) -> Intake:
        return Intake(fresh=tuple(one for one in events if one.seq > record.acked_seq))

    patch.setattr(host_session, "check_events", check)


def requeue_on_silence(patch: Patch) -> None:
    """What was sent to a host that fell silent is put back into the queue."""
    real = sim_server.SimServer.isolate

    def isolate(self: sim_server.SimServer) -> None:
        real(self)
        for made in self.jobs:
            state = self.host(made.host).state
            if state is SessionState.ISOLATED and made.state in AT_EDGE:
                self.attempts[made.actions[-1].id].locks = ()
                self.move(made, JobState.QUEUED, Mover.SERVER)

    patch.setattr(
        "labweb.domain.runs.states.job_states.STEPS",
        STEPS | {(state, JobState.QUEUED, Mover.SERVER) for state in AT_EDGE},
    )
    patch.setattr(sim_server.SimServer, "isolate", isolate)


def no_seal(patch: Patch) -> None:
    """There is no witness outside the journal."""
    patch.setattr(sim_host, "find_regression", lambda chain, seal: None)
    patch.setattr(sim_host, "is_raised", lambda found, wanted, hash_at_found: True)
    _hello(patch, lambda hello: msgspec.structs.replace(hello, seal_seq=0))


def no_cold_boot_hold(patch: Patch) -> None:
    """A machine that was restarted goes on by itself."""
    real = host_state.state_of

    def state_of(meta: dict[str, str], boot_id: str) -> HostState:
        found = real(meta, boot_id)
        was_armed = found.armed_boot_id is not None
        return replace(found, armed_boot_id=boot_id if was_armed else None)

    patch.setattr("tests.simulation.memory.state_of", state_of)


def hold_in_memory(patch: Patch) -> None:
    """The hold of a cold start is forgotten when the program alone starts again."""
    real_start = SimHost.start
    real_state = host_state.state_of
    held: dict[str, bool] = {}

    def start(self: SimHost, *, is_cold: bool) -> None:
        held[self.name + self.boot_id] = False
        real_start(self, is_cold=is_cold)
        held[self.name + self.boot_id] = is_cold

    def state_of(meta: dict[str, str], boot_id: str) -> HostState:
        found = real_state(meta, boot_id)
        name = "A" if found.host_id.int % 2 else "B"
        is_free = not held.get(name + boot_id, True) and found.armed_boot_id is not None
        return replace(found, armed_boot_id=boot_id) if is_free else found

    patch.setattr(SimHost, "start", start)
    patch.setattr("tests.simulation.memory.state_of", state_of)


def _hello(patch: Patch, change: Callable[[Hello], Hello]) -> None:
    real = SimHost.hello
    patch.setattr(SimHost, "hello", lambda self: change(real(self)))


OF_THE_PROTOCOL: tuple[Mutant, ...] = (
    no_dedupe,
    locks_off,
    started_after_acting,
    retry_after_crash,
    no_epoch_check,
    ignore_regression,
    accept_gaps,
    requeue_on_silence,
    no_seal,
    no_cold_boot_hold,
    hold_in_memory,
)


@contextmanager
def mutated(mutant: Mutant) -> Iterator[None]:
    """Play with one rule removed."""
    with pytest.MonkeyPatch.context() as patch:
        mutant(patch)
        yield
