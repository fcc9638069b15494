"""An action that begins in the write that ends the one before."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from uuid import UUID

import pytest

from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.messages.commands import Cancel
from labweb.domain.runs.host_actions import action_execution
from labweb.domain.runs.host_journal.journal_rows import JournalError
from tests.workers.bench import DEVICE_ID, HOST_ID, Host, PumpProcess, a_do, plain
from workers.base import faults
from workers.line import outcome_record
from workers.line.action_watchdog import AbandonedActionError

BEGUN = ["actuated", "complete", "started"]


def two(host: Host, **second: Any) -> tuple[UUID, UUID]:  # noqa: ANN401 - any field
    """Accept two actions of the pump."""
    first, later = a_do(host.server), a_do(host.server, resources=[], **second)
    host.take(first)
    host.take(later)
    return first.action_id, later.action_id


def at(patch: pytest.MonkeyPatch, name: str, do: Callable[[], None]) -> None:
    """Do something each time that a point is passed."""
    patch.setattr(faults, "point", lambda passed: do() if passed == name else None)


def commits_of(host: Host, drain: Callable[[], object]) -> int:
    """Count the writes that reached the disk."""
    told: list[str] = []
    host.journal._connection.set_trace_callback(told.append)
    drain()
    host.journal._connection.set_trace_callback(None)
    return told.count("COMMIT")


def test_the_end_and_the_next_start_are_one_write_and_sealed_before_the_device_acts(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    two(host)
    sealed: list[tuple[int, int, int]] = []

    def look() -> None:
        seal = host.journal.seal()
        assert seal is not None
        sealed.append((seal.seq, host.journal.head()[0], len(pump.moves)))

    at(monkeypatch, "execute.after_started", look)
    with host.executor() as executor:
        assert commits_of(host, executor.drain) == 3
    assert pump.moves == ["A300", "A600"]
    assert host.kinds()[-6:] == ["started", *BEGUN, "actuated", "complete"]
    assert [(seal == head, moves) for seal, head, moves in sealed] == [(True, 0), (True, 1)]


def test_what_is_read_before_an_action_is_read_after_the_one_before_has_ended(
    host: Host, pump: PumpProcess
) -> None:
    before = Condition(
        name="pump.volume", device_id=DEVICE_ID, status="volume_ul", low=50.0, high=150.0
    )
    two(host, pre=[plain(before)])
    with host.executor() as executor:
        assert commits_of(host, executor.drain) == 4
    assert pump.moves == ["A300", "A600"]
    _, started = [one.body for one in host.events() if one.kind == "started"]
    assert started["pre"][0]["verdict"] == "pass"


def test_a_disk_that_refuses_both_takes_the_end_alone(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outcome_record, "LAST_WRITE_PAUSE_S", 0.001)
    first, second = two(host)
    real = action_execution.start
    refused: list[Any] = []

    def start(tx: Any, row: Any, *known: Any, **more: Any) -> Any:  # noqa: ANN401 - as it is
        if row.action_id == second and not refused:
            refused.append(row)
            raise JournalError("the disk is full")
        return real(tx, row, *known, **more)

    monkeypatch.setattr(action_execution, "start", start)
    with host.executor() as executor:
        assert executor.drain() == 2
    assert refused
    assert (host.state(first), host.state(second)) == ("complete", "complete")
    assert pump.moves == ["A300", "A600"]


def test_an_action_that_was_cancelled_while_the_one_before_acted_never_starts(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = two(host)
    cancel = Cancel(
        host_id=HOST_ID, epoch=host.server.epoch, dseq=host.server.next_dseq(), action_id=second
    )
    told: list[object] = []

    def tell() -> None:
        if not told:
            told.append(host.take(cancel))

    at(monkeypatch, "execute.before_actuated", tell)
    with host.executor() as executor:
        executor.drain()
    assert (host.state(first), host.kinds(second)[-1]) == (("complete", "stopped"))
    assert pump.moves == ["A300"]


def test_a_process_that_dies_between_them_leaves_the_next_one_in_doubt_and_unsent(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = two(host)
    at(monkeypatch, "execute.after_done", lambda: 1 // 0)  # type: ignore[arg-type]
    with host.executor() as executor, pytest.raises(AbandonedActionError):
        executor.drain()
    monkeypatch.undo()
    assert (host.state(first), host.state(second)) == ("complete", "started")
    monkeypatch.setenv("LABWEB_BOOT_ID", host.journal.boot_id)
    with host.executor() as executor:
        assert executor.drain() == 0
    assert host.state(second) == "in_doubt"
    assert pump.moves == ["A300"]
