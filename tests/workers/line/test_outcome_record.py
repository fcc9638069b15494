"""An outcome waits for room, and is given up only where the disk refuses for another reason."""

from __future__ import annotations

import pytest

from labweb.domain.runs.host_journal.journal_rows import JournalError
from tests.workers.bench import Host, PumpProcess, a_do
from workers.base.disk_space import disk_space_of, is_short
from workers.journal.journal import Journal
from workers.line import outcome_record
from workers.line.action_watchdog import AbandonedActionError

REFUSALS = 5


def refuse_outcomes(patch: pytest.MonkeyPatch, count: int) -> list[int]:
    """Let the disk refuse so many writes of what came of an action."""
    refused: list[int] = []
    real = outcome_record.OutcomeRecord._write_end

    def write(self: outcome_record.OutcomeRecord, *rest: object) -> object:
        if len(refused) < count:
            refused.append(1)
            raise JournalError("the journal cannot be used: database or disk is full")
        return real(self, *rest)  # type: ignore[arg-type]

    patch.setattr(outcome_record.OutcomeRecord, "_write_end", write)
    patch.setattr(outcome_record, "LAST_WRITE_TRIES", 2)
    patch.setattr(outcome_record, "LAST_WRITE_PAUSE_S", 0.001)
    return refused


def test_an_outcome_waits_for_a_full_disk_however_long(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    do = a_do(host.server)
    host.take(do)
    refused = refuse_outcomes(monkeypatch, REFUSALS)
    monkeypatch.setattr(outcome_record, "is_short", lambda _folder: len(refused) < REFUSALS)
    with host.executor() as executor:
        executor.drain()
    assert len(refused) == REFUSALS
    assert host.journal.state_of(do.action_id) == "complete"
    assert len(pump.moves) == 1


def test_an_outcome_that_a_disk_with_room_refuses_is_given_up(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    host.take(a_do(host.server))
    refuse_outcomes(monkeypatch, REFUSALS)
    with host.executor() as executor, pytest.raises(AbandonedActionError):
        executor.drain()
    assert len(pump.moves) == 1


def test_what_is_told_of_a_disk_is_what_the_system_says(host: Host) -> None:
    journal: Journal = host.journal
    told = disk_space_of(journal.path.parent)
    assert 0 < told["disk_free_bytes"] <= told["disk_total_bytes"]
    assert not told["is_disk_read_only"]
    assert not is_short(journal.path.parent)
