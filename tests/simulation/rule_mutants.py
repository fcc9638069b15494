"""The same for every rule beside those that the protocol names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.messages.commands import Reset
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.messages.session import Hello
from labweb.domain.runs.dispatch import command_outbox, work_of_absent_host
from labweb.domain.runs.host_actions import command_acceptance, host_state
from labweb.domain.runs.host_journal import action_states, journal_rows
from labweb.domain.runs.host_journal import known_resources as record
from labweb.domain.runs.host_journal.journal_rows import Seal
from labweb.domain.runs.host_link import host_session
from labweb.domain.runs.host_link.host_session import HelloAnswer, HostRecord, Intake
from labweb.domain.runs.states import host_event_meaning
from labweb.domain.runs.states.job_states import JobState
from tests.simulation import host as sim_host
from tests.simulation import server as sim_server
from tests.simulation.host import SimHost
from tests.simulation.memory import MemoryWrite
from tests.simulation.mutants import Mutant, Patch


def no_floor(patch: Patch) -> None:
    """What the server has given up may still be taken and started."""
    real = host_state.state_of
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


def told_before_sealed(patch: Patch) -> None:
    """What a crash left behind the seal is told all the same."""
    patch.setattr(SimHost, "seal_up", lambda self: None)


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
    real_find, real_raise = journal_rows.find_regression, journal_rows.is_raised

    def find(chain: journal_rows.JournalChain, seal: Seal | None) -> str | None:
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
    real = journal_rows.find_regression

    def find(chain: journal_rows.JournalChain, seal: Seal | None) -> str | None:
        known = None if seal is None else seal.hash
        return real(replace(chain, hash_at_seal=known), seal)

    patch.setattr(sim_host, "find_regression", find)


def no_fork_check(patch: Patch) -> None:
    """Events need only be numbered without a gap."""
    real = host_session._decide_history

    def check(record: HostRecord, events: Sequence[EdgeEvent]) -> Intake:
        fresh = tuple(one for one in events if one.seq > record.acked_seq)
        for number, one in enumerate(fresh, start=record.acked_seq + 1):
            if one.seq != number:
                return Intake(code="host.gap")
        return Intake(fresh=fresh)

    def decide(record: HostRecord, hello: Hello) -> HelloAnswer:
        return real(record, msgspec.structs.replace(hello, hash_head=record.hash_at_acked))

    patch.setattr(host_session, "check_events", check)
    patch.setattr(host_session, "_decide_history", decide)


def events_applied_again(patch: Patch) -> None:
    """What was read before is applied when it comes again."""
    patch.setattr(host_session, "check_events", lambda record, events: Intake(fresh=tuple(events)))


def quarantine_ends_by_itself(patch: Patch) -> None:
    """A host in quarantine is let in at its next HELLO, with the journal it has."""
    real = host_session.decide_hello

    def decide(record: HostRecord, hello: Hello, **known: Any) -> HelloAnswer:  # noqa: ANN401
        if not record.quarantine:
            return real(record, hello, **known)
        return HelloAnswer("normal")

    real_after = host_session.after_hello

    def after(record: HostRecord, hello: Hello, answer: HelloAnswer) -> host_session.Opening:
        if answer.kind == "normal":
            record = replace(record, quarantine="")
        return real_after(record, hello, answer)

    patch.setattr(host_session, "decide_hello", decide)
    patch.setattr(host_session, "after_hello", after)


def quarantine_keeps_jobs(patch: Patch) -> None:
    """What a fenced host was given is not put in doubt."""
    patch.setattr(sim_server.SimServer, "_fence", lambda self, host, code: None)


def answer_before_stock(patch: Patch) -> None:
    """A person settles on the server while the old journal may still be at work."""
    patch.setattr(host_session, "is_given_up", lambda record, dseq: dseq < record.floor)


def resume_before_read(patch: Patch) -> None:
    """The host is resumed before its log was read to the end."""
    patch.setattr(host_session, "is_caught_up", lambda acked_seq, seq_head: True)


def old_epoch_stays(patch: Patch) -> None:
    """A command is sent again under the epoch it was written in."""
    patch.setattr(command_outbox, "stamped", lambda command, epoch, *, at: command)


def refusal_ends_any_job(patch: Patch) -> None:
    """A refused command ends its job, wherever the job stands."""
    ended = JobState.REJECTED
    patch.setattr(
        host_event_meaning,
        "_read_refusal",
        lambda body, _: host_event_meaning._read_end(ended, body),
    )


def dependents_go_on(patch: Patch) -> None:
    """Only the silent host's own jobs are suspended."""

    def reached(jobs: Sequence[Any], hosts: set[UUID]) -> set[int]:
        return {job.index for job in jobs if job.host_id in hosts}

    patch.setattr(work_of_absent_host, "_reached", reached)


def nobody_is_isolated(patch: Patch) -> None:
    """A silent host's jobs wait in the queue."""
    patch.setattr(work_of_absent_host, "_reached", lambda jobs, hosts: set())


def record_is_not_adopted(patch: Patch) -> None:
    """A host keeps what it knows of a vessel, though the server knows more."""
    real = record.adopt

    def adopt(tx: MemoryWrite, views: Sequence[Any]) -> None:
        real(tx, [view for view in views if tx.resource(view.id) is None])

    patch.setattr(command_acceptance, "adopt", adopt)


def doubt_does_not_close(patch: Patch) -> None:
    """A device with an action in doubt goes on with the next."""
    patch.setattr("tests.simulation.memory.Disk.blocked_by", lambda self, device_id: None)
    patch.setattr(action_states, "_decide_hold", lambda host, blocked_by: None)


def no_latch(patch: Patch) -> None:
    """A stopped lab goes on."""
    real = host_state.state_of
    patch.setattr(
        "tests.simulation.memory.state_of",
        lambda meta, boot_id: replace(real(meta, boot_id), stop_latched=False),
    )


def any_reset_opens(patch: Patch) -> None:
    """The reset of any stop opens the latch."""
    real = command_acceptance._take_reset

    def take(tx: MemoryWrite, reset: Reset) -> command_acceptance.Receipt:
        stop_id = UUID(tx.meta().get("stop_id", str(reset.stop_id)))
        return real(tx, msgspec.structs.replace(reset, stop_id=stop_id))

    patch.setattr(command_acceptance, "_take_reset", take)


def any_process_speaks(patch: Patch) -> None:
    """A second process is let in while the first is alive."""
    real = host_session.decide_hello
    patch.setattr(host_session, "decide_hello", lambda record, hello, **_: real(record, hello))


def boots_are_forgotten(patch: Patch) -> None:
    """A start of the machine may come back after another one."""
    real = host_session.decide_hello
    patch.setattr(
        host_session,
        "decide_hello",
        lambda record, hello, **known: real(replace(record, boots=()), hello, **known),
    )


def nobody_is_heard(patch: Patch) -> None:
    """The server does not remember in which session the host has spoken."""
    patch.setattr(host_session, "heard", lambda record: record)


def one_person_fences(patch: Patch) -> None:
    """The second signature under a fence may be the first person's."""
    real = host_session.check_fence
    patch.setattr(
        host_session, "check_fence", lambda state, first_by, actor: real(state, None, actor)
    )


def lost_hosts_are_waited_for(patch: Patch) -> None:
    """Answers about a host that two people declared lost wait for it all the same."""
    real = host_session.is_given_up
    patch.setattr(
        host_session,
        "is_given_up",
        lambda record, dseq: not record.quarantine and real(record, dseq),
    )


OF_THE_RULES: tuple[Mutant, ...] = (
    no_floor,
    no_fence,
    no_tombstone,
    told_before_sealed,
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
    no_latch,
    any_reset_opens,
    any_process_speaks,
    boots_are_forgotten,
    nobody_is_heard,
    one_person_fences,
    lost_hosts_are_waited_for,
)
