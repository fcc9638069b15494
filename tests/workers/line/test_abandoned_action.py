"""An action that was started and that nobody looks after any more ends its process."""

from __future__ import annotations

import pytest

from labweb.domain.runs.host_actions import action_execution
from labweb.domain.runs.host_journal.journal_rows import JournalError
from tests.workers.bench import Host, PumpProcess, a_do
from workers.base import faults
from workers.journal.journal import Journal
from workers.line import outcome_record
from workers.line.action_watchdog import AbandonedActionError


def fail_at(monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    def point(name: str) -> None:
        if name == place:
            raise ZeroDivisionError(name)

    monkeypatch.setattr(faults, "point", point)


def test_a_bug_between_start_and_answer_is_not_passed_over(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = a_do(host.server), a_do(host.server, resources=[])
    host.take(first)
    host.take(second)
    with host.executor() as line:
        fail_at(monkeypatch, "execute.before_actuated")
        with pytest.raises(AbandonedActionError):
            line.drain()
        monkeypatch.undo()
    monkeypatch.setenv("LABWEB_BOOT_ID", host.journal.boot_id)
    assert host.state(first.action_id) == "started"
    with host.executor() as line:
        assert line.drain() == 0
    assert host.state(first.action_id) == "in_doubt"
    assert host.state(second.action_id) == "accepted"
    assert pump.moves == ["A300"]


def test_a_bug_before_the_start_leaves_the_action_accepted_and_the_process_alive(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    do = a_do(host.server)
    host.take(do)
    with host.executor() as line:
        fail_at(monkeypatch, "execute.before_started")
        with pytest.raises(ZeroDivisionError):
            line.drain()
    assert host.state(do.action_id) == "accepted"
    assert pump.moves == []


def test_an_outcome_that_never_reaches_the_disk_ends_the_process(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the next action of the device would start on a record that is out of date."""
    monkeypatch.setattr(outcome_record, "LAST_WRITE_PAUSE_S", 0.001)
    do = a_do(host.server)
    host.take(do)

    def refuse(*_known: object) -> None:
        raise JournalError("the disk is full")

    with host.executor() as line:
        monkeypatch.setattr(action_execution, "write_end", refuse)
        with pytest.raises(AbandonedActionError):
            line.drain()
    assert pump.moves == ["A300"]
    assert host.state(do.action_id) == "started"


def test_a_journal_that_cannot_be_read_for_a_moment_does_not_end_the_waiting_for_a_device(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    pump.tell("slow 3")
    do, later = a_do(host.server), a_do(host.server, resources=[])
    host.take(do)
    host.take(later)
    count = 0
    read = Journal.action

    def action(journal: Journal, action_id: object) -> object:
        nonlocal count
        count += 1
        if count < 4:
            raise JournalError("the journal cannot be used: database is locked")
        return read(journal, action_id)  # type: ignore[arg-type]

    with host.executor() as line:
        monkeypatch.setattr(Journal, "action", action)
        assert line.drain() == 2
        monkeypatch.undo()
    assert count >= 4
    assert host.kinds(do.action_id)[-1] == "complete"
    assert pump.moves == ["A300", "A600"]
