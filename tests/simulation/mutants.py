"""The protocol with one rule removed: each must be found out by the checks.

A mutant replaces a rule for as long as a schedule is played. `SEEDS` pins a schedule that
kills it; where random ones are too rare, a directed schedule stands in `directed.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from uuid import UUID

import msgspec
import pytest

from labweb.domain.messages import EdgeEvent, Hello
from labweb.domain.runs import (
    acting,
    edge,
    intake,
    isolation,
    journal,
    locks,
    record,
    relay,
    session,
    standing,
    taking,
)
from labweb.domain.runs.edge import ActionState, Answer, HostState
from labweb.domain.runs.job import AT_EDGE, STEPS, JobState, Mover
from labweb.domain.runs.journal import ActionRow, Seal
from labweb.domain.runs.session import HelloAnswer, HostRecord, Intake, SessionState
from tests.simulation import host as sim_host
from tests.simulation import server as sim_server
from tests.simulation.host import SimHost
from tests.simulation.memory import MemoryWrite

Patch = pytest.MonkeyPatch
Mutant = Callable[[Patch], None]


def no_dedupe(patch: Patch) -> None:
    """A command that comes again is taken again."""
    real = edge.decide_accept

    def decide(host: HostState, **known: Any) -> Answer:  # noqa: ANN401 - as the rule
        return real(host, **{**known, "known": None})

    def insert(self: MemoryWrite, row: ActionRow) -> None:
        self._put(self._disk.actions, row.action_id, row)

    patch.setattr(edge, "decide_accept", decide)
    patch.setattr(MemoryWrite, "insert_action", insert)


def locks_off(patch: Patch) -> None:
    """Nothing is ever in use."""
    patch.setattr(locks, "conflicts", lambda wanted, held: [])


def started_after_acting(patch: Patch) -> None:
    """The start is written when the device has answered."""

    def attempt(self: SimHost, row: ActionRow) -> Generator[str, None, bool]:
        started = acting.Started(row, row.do)
        if self.is_held(row):
            return False
        yield "before started"
        self.lab.begin(self, started)
        self.acting = started
        yield "acting"
        report = self.lab.finish(self, started)
        self.acting = None
        with self.write() as tx:
            acting.start(tx, row, row.do, at=self.moment(), scene=sim_host.SCENE)
        yield "before actuated"
        with self.write() as tx:
            acting.write_end(tx, row, report, [])
        return True

    patch.setattr(SimHost, "_try", attempt)


def retry_after_crash(patch: Patch) -> None:
    """What was started and not answered is begun again."""

    def recover(tx: MemoryWrite, row: ActionRow) -> bool:
        if tx.state_of(row.action_id) is ActionState.STARTED:
            tx._put(tx._disk.actions, row.action_id, replace(row, st=ActionState.ACCEPTED))
            tx._disk.fences.pop(row.device_id, None)
        return False

    patch.setattr(acting, "recover", recover)


def no_epoch_check(patch: Patch) -> None:
    """A command of an older session counts."""
    real = edge.decide_accept

    def decide(host: HostState, **known: Any) -> Answer:  # noqa: ANN401 - as the rule
        return real(host, **{**known, "epoch": host.epoch})

    patch.setattr(edge, "decide_accept", decide)


def ignore_regression(patch: Patch) -> None:
    """A journal that went back in time is as good as any."""
    patch.setattr(sim_host, "find_regression", lambda chain, seal: None)
    patch.setattr(sim_host, "is_raised", lambda found, wanted, hash_at_found: True)

    def decide(record: HostRecord, hello: Hello) -> HelloAnswer:
        return HelloAnswer("normal")

    patch.setattr(session, "decide_hello", decide)


def accept_gaps(patch: Patch) -> None:
    """Events are applied though one before them is missing."""

    def check(record: HostRecord, events: Sequence[EdgeEvent]) -> Intake:
        return Intake(fresh=tuple(one for one in events if one.seq > record.acked_seq))

    patch.setattr(session, "check_events", check)


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
        "labweb.domain.runs.job.STEPS",
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
    real = standing.state_of

    def state_of(meta: dict[str, str], boot_id: str) -> HostState:
        found = real(meta, boot_id)
        was_armed = found.armed_boot_id is not None
        return replace(found, armed_boot_id=boot_id if was_armed else None)

    patch.setattr("tests.simulation.memory.state_of", state_of)


def hold_in_memory(patch: Patch) -> None:
    """The hold of a cold start is forgotten when the program alone starts again."""
    real_start = SimHost.start
    real_state = standing.state_of
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


# --- one for every rule beside those ---


def no_floor(patch: Patch) -> None:
    """What the server has given up may still be taken and started."""
    real = standing.state_of
    patch.setattr(
        "tests.simulation.memory.state_of",
        lambda meta, boot_id: replace(real(meta, boot_id), floor=0),
    )


def no_fence(patch: Patch) -> None:
    """An earlier dispatch may start after a later one."""
    patch.setattr(MemoryWrite, "max_fence", lambda self, device_id: 0)


def no_tombstone(patch: Patch) -> None:
    """A cancel that comes before its command is forgotten."""
    patch.setattr(MemoryWrite, "is_tombstoned", lambda self, action_id: False)


def seal_moves_anyway(patch: Patch) -> None:
    """A journal that was put back wipes out the evidence as soon as it is long enough."""

    def raised(found: Seal, wanted: Seal, *, hash_at_found: str | None) -> bool:
        return wanted.seq > found.seq

    patch.setattr(sim_host, "is_raised", raised)


def seal_goes_back(patch: Patch) -> None:
    """The seal follows the journal wherever it goes."""
    patch.setattr(sim_host, "is_raised", lambda found, wanted, hash_at_found: True)


def seal_of_any_journal(patch: Patch) -> None:
    """The seal is bound neither to its journal nor to an event of it."""
    real_find, real_raise = journal.find_regression, journal.is_raised

    def find(chain: journal.Chain, seal: Seal | None) -> str | None:
        if seal is not None:
            hash_ = seal.hash if chain.hash_at_seal is not None else None
            seal = msgspec.structs.replace(seal, journal_id=chain.journal_id)
            chain = replace(chain, hash_at_seal=hash_)
        return real_find(chain, seal)

    def raised(found: Seal, wanted: Seal, *, hash_at_found: str | None) -> bool:
        same = msgspec.structs.replace(found, journal_id=wanted.journal_id)
        return real_raise(same, wanted, hash_at_found=hash_at_found)

    patch.setattr(sim_host, "find_regression", find)
    patch.setattr(sim_host, "is_raised", raised)


def only_length_of_seal(patch: Patch) -> None:
    """A journal as long as its seal counts as the newest, whatever stands in it."""
    real = journal.find_regression

    def find(chain: journal.Chain, seal: Seal | None) -> str | None:
        known = None if seal is None else seal.hash
        return real(replace(chain, hash_at_seal=known), seal)

    patch.setattr(sim_host, "find_regression", find)


def no_fork_check(patch: Patch) -> None:
    """Events need only be numbered without a gap."""
    real = session._decide_history

    def check(record: HostRecord, events: Sequence[EdgeEvent]) -> Intake:
        fresh = tuple(one for one in events if one.seq > record.acked_seq)
        for number, one in enumerate(fresh, start=record.acked_seq + 1):
            if one.seq != number:
                return Intake(code="host.gap")
        return Intake(fresh=fresh)

    def decide(record: HostRecord, hello: Hello) -> HelloAnswer:
        return real(record, msgspec.structs.replace(hello, hash_head=record.hash_at_acked))

    patch.setattr(session, "check_events", check)
    patch.setattr(session, "_decide_history", decide)


def events_applied_again(patch: Patch) -> None:
    """What was read before is applied when it comes again."""
    patch.setattr(session, "check_events", lambda record, events: Intake(fresh=tuple(events)))


def quarantine_ends_by_itself(patch: Patch) -> None:
    """A host in quarantine is let in at its next HELLO, with the journal it has."""
    real = session.decide_hello

    def decide(record: HostRecord, hello: Hello) -> HelloAnswer:
        if not record.quarantine:
            return real(record, hello)
        return HelloAnswer("normal")

    real_after = session.after_hello

    def after(record: HostRecord, hello: Hello, answer: HelloAnswer) -> session.Opening:
        if answer.kind == "normal":
            record = replace(record, quarantine="")
        return real_after(record, hello, answer)

    patch.setattr(session, "decide_hello", decide)
    patch.setattr(session, "after_hello", after)


def quarantine_keeps_jobs(patch: Patch) -> None:
    """What a fenced host was given is not put in doubt."""
    patch.setattr(sim_server.SimServer, "_fence", lambda self, host, code: None)


def answer_before_stock(patch: Patch) -> None:
    """A person settles on the server while the old journal may still be at work."""
    patch.setattr(session, "is_given_up", lambda record, dseq: dseq < record.floor)


def resume_before_read(patch: Patch) -> None:
    """The host is resumed before its log was read to the end."""
    patch.setattr(session, "is_caught_up", lambda acked_seq, seq_head: True)


def old_epoch_stays(patch: Patch) -> None:
    """A command is sent again under the epoch it was written in."""
    patch.setattr(relay, "stamped", lambda command, epoch: command)


def refusal_ends_any_job(patch: Patch) -> None:
    """A refused command ends its job, wherever the job stands."""
    ended = JobState.REJECTED
    patch.setattr(intake, "_read_refusal", lambda body, _: intake._read_end(ended, body))


def dependents_go_on(patch: Patch) -> None:
    """Only the silent host's own jobs are suspended."""

    def reached(jobs: Sequence[Any], hosts: set[UUID]) -> set[int]:
        return {job.index for job in jobs if job.host_id in hosts}

    patch.setattr(isolation, "_reached", reached)


def nobody_is_isolated(patch: Patch) -> None:
    """A silent host's jobs wait in the queue."""
    patch.setattr(isolation, "_reached", lambda jobs, hosts: set())


def record_is_not_adopted(patch: Patch) -> None:
    """A host keeps what it knows of a vessel, though the server knows more."""
    real = record.adopt

    def adopt(tx: MemoryWrite, views: Sequence[Any]) -> None:
        real(tx, [view for view in views if tx.resource(view.id) is None])

    patch.setattr(taking, "adopt", adopt)


def doubt_does_not_close(patch: Patch) -> None:
    """A device with an action in doubt goes on with the next."""
    patch.setattr("tests.simulation.memory.Disk.blocked_by", lambda self, device_id: None)
    patch.setattr(edge, "_decide_hold", lambda host, blocked_by: None)


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

OF_THE_RULES: tuple[Mutant, ...] = (
    no_floor,
    no_fence,
    no_tombstone,
    seal_moves_anyway,
    seal_goes_back,
    seal_of_any_journal,
    only_length_of_seal,
    no_fork_check,
    events_applied_again,
    quarantine_ends_by_itself,
    quarantine_keeps_jobs,
    answer_before_stock,
    resume_before_read,
    old_epoch_stays,
    refusal_ends_any_job,
    dependents_go_on,
    nobody_is_isolated,
    record_is_not_adopted,
    doubt_does_not_close,
)


@contextmanager
def mutated(mutant: Mutant) -> Iterator[None]:
    """Play with one rule removed."""
    with pytest.MonkeyPatch.context() as patch:
        mutant(patch)
        yield
