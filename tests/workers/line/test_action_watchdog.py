"""An action on its line's thread, and the thread beside it that halts and looks ahead."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any
from uuid import UUID

import pytest

from labweb.domain.runs.host_journal.journal_rows import JournalError
from tests.workers.bench import DEVICE_ID, Host, PumpProcess, a_do, until
from workers.base.signatures import is_signed
from workers.journal.journal import Journal
from workers.line import action_execution, line_thread
from workers.line.action_watchdog import AbandonedActionError, HungDriverError
from workers.line.device_unit import DeviceUnit
from workers.line.line_thread import LineThread


class Hang:
    """A driver's action that comes back when it is told to, whatever its device does."""

    def __init__(self, act: Callable[..., Any]) -> None:
        self._act = act
        self.has_begun, self.may_return, self.has_returned = (threading.Event() for _ in range(3))

    def __call__(self, *known: Any) -> Any:  # noqa: ANN401 - as the driver's own
        self.thread = threading.current_thread()
        told = self._act(*known)
        self.has_begun.set()
        self.may_return.wait(30)
        self.has_returned.set()
        return told


@pytest.fixture
def hang(monkeypatch: pytest.MonkeyPatch) -> Hang:
    made = Hang(DeviceUnit.act)

    def act(unit: DeviceUnit, *known: Any) -> Any:  # noqa: ANN401 - as the driver's own
        return made(unit, *known)

    monkeypatch.setattr(DeviceUnit, "act", act)
    return made


def test_an_action_whose_driver_hangs_is_in_doubt_and_its_late_return_changes_nothing(
    host: Host, pump: PumpProcess, hang: Hang, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(action_execution, "outer_limit_s", lambda *_: 0.2)
    monkeypatch.setattr(action_execution, "HALT_GRACE_S", 0.2)
    do, later = a_do(host.server), a_do(host.server, resources=[])
    host.take(do)
    host.take(later)
    with host.executor() as executor:
        with pytest.raises(HungDriverError):
            executor.drain()
        assert host.last(do.action_id)["code"] == "edge.watchdog"
        assert host.last(do.action_id)["report"]["evidence"]["is_hung"] is True
        assert host.units[DEVICE_ID].driver.is_stopped, "what it is in the midst of goes no further"
        assert host.journal.host_state().owes_halt == {str(DEVICE_ID)}
        known = host.journal.head()
        hang.may_return.set()
        hang.thread.join(1)  # it waits for work that nobody gives it
        executor.close()
    assert hang.has_returned.is_set()
    assert host.journal.head() == known
    assert (host.state(do.action_id), host.state(later.action_id)) == ("in_doubt", "accepted")
    assert pump.moves == ["A300"]


def test_what_comes_back_within_the_grace_is_told_with_what_it_said(
    host: Host, pump: PumpProcess, hang: Hang, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(action_execution, "outer_limit_s", lambda *_: 0.2)
    stop = DeviceUnit.stop

    def come_back(unit: DeviceUnit) -> None:
        stop(unit)
        hang.may_return.set()

    monkeypatch.setattr(DeviceUnit, "stop", come_back)
    do = a_do(host.server)
    host.take(do)
    with host.executor() as executor:
        executor.drain()
    told = host.last(do.action_id)
    assert (host.state(do.action_id), told["code"]) == ("in_doubt", "edge.watchdog")
    assert told["report"]["evidence"]["is_hung"] is False
    assert told["report"]["evidence"]["late"]


def test_a_cancel_that_comes_with_the_end_does_not_halt_what_follows(
    host: Host, pump: PumpProcess, hang: Hang, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The word is read while the action acts, and its device would be halted after the end."""
    first, second = a_do(host.server), a_do(host.server, resources=[])
    host.take(first)
    host.take(second)
    read = Journal.action

    def read_late(journal: Journal, action_id: UUID) -> Any:  # noqa: ANN401 - as it is
        found = read(journal, action_id)
        if found is not None and found.is_cancel_wanted:
            hang.may_return.set()
            until(lambda: host.kinds(second.action_id)[-1] == "complete")
        return found

    with host.executor() as executor:
        worker = threading.Thread(target=executor.drain)
        worker.start()
        assert hang.has_begun.wait(10)
        monkeypatch.setattr(Journal, "action", read_late)
        journal = Journal(host.path)
        with journal.write() as tx:
            tx.want_cancel(first.action_id)
        journal.close()
        worker.join(20)
    kinds = [host.kinds(one.action_id)[-1] for one in (first, second)]
    assert kinds == ["complete", "complete"]
    assert not host.units[DEVICE_ID].driver.is_stopped
    assert "halted" not in host.kinds()
    assert pump.moves == ["A300", "A600"]


def test_a_fault_of_the_watch_ends_the_process_and_leaves_the_action_to_the_next(
    host: Host, pump: PumpProcess, hang: Hang, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> bool:
        raise ZeroDivisionError

    monkeypatch.setattr(action_execution.ActionExecution, "look", fail)
    do = a_do(host.server)
    host.take(do)
    with host.executor() as executor, pytest.raises(AbandonedActionError):
        executor.drain()
    assert host.state(do.action_id) == "started"
    monkeypatch.setenv("LABWEB_BOOT_ID", host.journal.boot_id)
    with host.executor() as executor:
        assert executor.drain() == 0
    hang.may_return.set()
    hang.thread.join(1)  # what was left behind cannot end it any more
    assert host.state(do.action_id) == "in_doubt"
    assert pump.moves == ["A300"]


def test_a_thread_that_could_not_be_started_is_started_the_next_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(_: object) -> None:
        raise RuntimeError("can't start new thread")

    thread = LineThread()
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", refuse)
        with pytest.raises(RuntimeError, match="new thread"):
            thread.run(lambda: 1, lambda: None)
    assert thread.run(lambda: 2, lambda: None) == 2
    thread.close()


def test_what_is_raised_beside_leaves_the_thread_and_the_next_work_has_its_own_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    thread, may_end = LineThread(), threading.Event()

    def stop() -> None:
        raise SystemExit

    with pytest.raises(SystemExit):
        thread.run(lambda: may_end.wait(30), stop)
    assert thread.is_left
    may_end.set()
    assert thread.run(lambda: 2, lambda: None) == 2
    assert not thread.is_left
    thread.close()


def test_work_raises_where_it_was_asked_for() -> None:
    thread = LineThread()

    def fail() -> None:
        raise JournalError("the disk is full")

    with pytest.raises(JournalError, match="the disk is full"):
        thread.run(fail, lambda: None)
    assert thread.run(lambda: threading.current_thread().name, lambda: None) == "line"
    thread.close()
    assert thread.run(lambda: 2, lambda: None) == 2
    thread.close()


def test_the_watch_looks_while_actions_are_read_ahead(host: Host) -> None:
    host.take(a_do(host.server))
    (row,) = host.journal.next_of(host.line, 1)
    thread = LineThread()
    looks: list[int] = []

    def work() -> None:
        while len(looks) < 2:
            thread.prepare(row, host.server.keys)

    thread.run(work, lambda: looks.append(1))
    thread.close()


def test_a_signature_is_checked_once_and_what_differs_is_checked_anew(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    host.take(a_do(host.server))
    (row,) = host.journal.next_of(host.line, 1)
    checked: list[str] = []
    real = is_signed

    def check(signed: Any, keys: Any) -> bool:  # noqa: ANN401 - as it is
        checked.append(signed.body)
        return real(signed, keys)

    monkeypatch.setattr(line_thread, "is_signed", check)
    thread, keys = LineThread(), host.server.keys
    thread.run(lambda: thread.prepare(row, keys), lambda: None)
    thread.close()
    assert len(checked) == 1
    assert thread.is_signed(row, keys)
    assert len(checked) == 1
    values = {name: getattr(row, name) for name in row.__dataclass_fields__}
    other = type(row)(**{**values, "body": row.body.replace("1000.0", "2000.0")})
    assert other.body != row.body
    assert not thread.is_signed(other, keys)
    assert not thread.is_signed(row, {})
    assert not thread.is_signed(row, {"k1": "A" * 43 + "="})


def test_a_command_that_was_changed_after_it_was_read_ahead_never_starts(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    dos = [a_do(host.server), *(a_do(host.server, resources=[], pre=[]) for _ in range(2))]
    for do in dos:
        host.take(do)
    act = DeviceUnit.act
    acted: list[object] = []

    def change(unit: DeviceUnit, *known: Any) -> Any:  # noqa: ANN401 - as the driver's own
        acted.append(known)
        if len(acted) < 2:
            return act(unit, *known)
        journal = Journal(host.path)
        query = "UPDATE action SET body = replace(body, '100.0', '900.0') WHERE action_id = ?"
        journal._connection.execute(query, (str(dos[2].action_id),))
        journal.close()
        return act(unit, *known)

    monkeypatch.setattr(DeviceUnit, "act", change)
    with host.executor() as executor:
        executor.drain()
    assert host.kinds(dos[2].action_id)[-1] == "rejected"
    assert host.last(dos[2].action_id)["code"] == "edge.bad_signature"
    assert pump.moves == ["A300", "A600"]
