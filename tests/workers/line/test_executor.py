"""One action, from the journal to the device and back."""

from __future__ import annotations

import threading
import time
from typing import Any
from uuid import UUID, uuid4

import msgspec
import pytest

from drivers.base import Driver, Report
from drivers.load import call_action
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.messages.commands import Cancel, Resolve
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.host_journal.action_states import ActionState
from labweb.domain.runs.host_journal.journal_rows import JournalError
from tests.workers.bench import (
    BOTTLE_ID,
    DEVICE_ID,
    HOST_ID,
    SYRINGE_ID,
    Host,
    PumpProcess,
    a_bottle,
    a_do,
    a_syringe,
    plain,
)
from workers.base.valkey_store import StatusSample, ValkeyStore
from workers.line import action_execution, device_unit
from workers.line.action_watchdog import AbandonedActionError
from workers.uplink.session import latch_stop

READ = {"op": "read", "device_id": str(DEVICE_ID), "statuses": ["volume_ul", "port_index"]}


def a_condition(**changes: Any) -> dict[str, Any]:  # noqa: ANN401 - any field
    known = Condition(name="pump.volume", device_id=DEVICE_ID, status="volume_ul")
    return plain(msgspec.structs.replace(known, **changes))


def run(host: Host, store: ValkeyStore | None = None, **changes: Any) -> UUID:  # noqa: ANN401 - any field
    """Accept one action with these fields, and carry it out."""
    do = a_do(host.server, **changes)
    host.take(do)
    with host.executor(store) as executor:
        executor.drain()
    return do.action_id


def test_an_accepted_action_is_carried_out_and_settled(host: Host, pump: PumpProcess) -> None:
    action_id = run(host, post=[a_condition(change=100.0, tolerance=1.0, timeout_s=1.0)])
    assert host.kinds(action_id) == ["accepted", "started", "actuated", "complete"]
    assert pump.moves == ["A300"]
    assert host.contents(BOTTLE_ID) == 4_900_000
    assert host.contents(SYRINGE_ID) == 100_000
    body = host.last(action_id)
    assert body["revs"] == {str(BOTTLE_ID): 2, str(SYRINGE_ID): 2}
    assert body["verification"] == "device"
    assert body["change"]["postings"][0]["amount_nl"] == 100_000
    assert body["post"][0]["verdict"] == "pass"
    assert host.journal.regression() is None


def test_a_driver_is_told_the_id_of_the_action_that_it_carries_out(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []

    def keep(device: Driver[Any, Any], action: str, args: dict[str, Any]) -> Report:
        told.append(device.action_id)
        return call_action(device, action, args)

    monkeypatch.setattr(device_unit, "call_action", keep)
    action_id = run(host)
    assert told == [str(action_id)]


def test_actions_of_a_line_start_in_dispatch_order(host: Host, pump: PumpProcess) -> None:
    first, second = a_do(host.server), a_do(host.server, resources=[])
    host.take(first)
    host.take(second)
    with host.executor() as executor:
        assert executor.drain() == 2
    assert pump.moves == ["A300", "A600"]


@pytest.mark.parametrize(
    ("admission", "code"),
    [
        ({}, "edge.not_admitted"),
        ({"dispense": {}}, "edge.not_admitted"),
        ({"aspirate": {"volume_ul": 99.9}}, "edge.over_limit"),
    ],
)
def test_what_was_withheld_is_refused_here_even_when_it_is_signed(
    host: Host, pump: PumpProcess, admission: dict[str, dict[str, float]], code: str
) -> None:
    host.device = msgspec.structs.replace(host.device, admission=admission)
    action_id = run(host)
    assert (host.state(action_id), host.last(action_id)["code"]) == ("rejected", code)
    assert pump.moves == []


def test_what_is_within_its_limit_is_carried_out(host: Host, pump: PumpProcess) -> None:
    host.device = msgspec.structs.replace(host.device, admission={"aspirate": {"volume_ul": 100}})
    assert host.state(run(host)) == "complete"
    assert pump.moves == ["A300"]


def test_an_earlier_dispatch_never_starts_after_a_later_one(host: Host, pump: PumpProcess) -> None:
    early = a_do(host.server)
    run(host)
    host.take(msgspec.structs.replace(early, resources=[]))
    with host.executor() as executor:
        executor.drain()
    assert host.last(early.action_id)["code"] == "edge.fenced"
    assert pump.moves == ["A300"]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"pre": [a_condition(equals=7)]}, "pump.volume"),
        ({"pre": [a_condition(device_id=uuid4(), name="other.ready", equals=1)]}, "other.ready"),
        ({"driver_digest": "0" * 64}, "edge.driver_digest"),
        ({"action": "halt"}, "edge.no_action"),
        ({"action": "__class__"}, "edge.no_action"),
        ({"ttl_s": 0.0}, "edge.expired"),
        ({"resources": [a_bottle(contents={"lot": 50}), a_syringe()]}, "crutd.insufficient_volume"),
        ({"resources": [a_bottle(), a_syringe(capacity_nl=9)]}, "crutd.capacity_exceeded"),
    ],
)
def test_what_may_not_start_is_rejected_and_the_device_stays_still(
    host: Host, pump: PumpProcess, change: dict[str, Any], code: str
) -> None:
    action_id = run(host, **change)
    assert host.state(action_id) == "rejected"
    assert host.last(action_id)["code"] == code
    assert pump.moves == []


def test_an_argument_the_driver_refuses_aborts_with_nothing_moved(
    host: Host, pump: PumpProcess
) -> None:
    action_id = run(host, args={"volume_ul": 1e9, "rate_ul_s": 1000.0})
    assert host.state(action_id) == "aborted"
    assert host.last(action_id)["change"]["state"] == "rolled_back"
    assert pump.moves == []


def test_a_sensor_that_contradicts_the_device_leaves_the_action_in_doubt(host: Host) -> None:
    action_id = run(host, post=[a_condition(equals=500)])
    assert host.state(action_id) == "in_doubt"
    assert host.last(action_id)["code"] == "pump.volume"
    assert host.quarantine(BOTTLE_ID) == str(action_id)
    assert host.quarantine(SYRINGE_ID) == str(action_id)
    assert host.contents(BOTTLE_ID) == 5_000_000


def test_a_device_that_falls_silent_leaves_the_action_in_doubt_and_closes_the_device(
    host: Host, pump: PumpProcess
) -> None:
    pump.tell("slow 100")
    do, later = a_do(host.server), a_do(host.server, resources=[])
    host.take(do)
    host.take(later)
    with host.executor() as executor:
        pump.tell("mute_after_move")
        executor.drain()
    assert host.state(do.action_id) == "in_doubt"
    assert host.last(do.action_id)["report"]["effect"] == "unknown"
    assert host.state(later.action_id) == "accepted"
    assert pump.moves == ["A300"]


def test_an_action_waits_for_a_device_that_is_offline(host: Host, pump: PumpProcess) -> None:
    pump.end()
    action_id = run(host)
    assert host.kinds(action_id) == ["accepted"]


def test_a_reading_of_another_line_counts_only_while_it_is_fresh(
    host: Host, store: ValkeyStore
) -> None:
    balance = uuid4()
    pre = [a_condition(device_id=balance, status="is_stable", equals=True)]
    now_s = time.monotonic()
    store.put("other", [StatusSample(str(balance), "is_stable", 0.0, now_s - 60.0, True)], 1)
    assert host.state(run(host, store, pre=pre)) == "rejected"
    now_s = time.monotonic()
    store.put("other", [StatusSample(str(balance), "is_stable", 0.0, now_s, True)], 2)
    assert host.state(run(host, store, pre=pre)) == "complete"


def test_what_another_line_told_before_the_question_refuses_nothing(
    host: Host, store: ValkeyStore
) -> None:
    """A valve that was turned a moment ago: its line has told where it stood before."""
    valve = uuid4()
    pre = [a_condition(device_id=valve, status="port_index", equals=7)]
    store.put("other", [StatusSample(str(valve), "port_index", 0.0, time.monotonic(), 1)], 1)

    def tell() -> None:
        time.sleep(0.5)
        store.put("other", [StatusSample(str(valve), "port_index", 0.0, time.monotonic(), 7)], 2)

    telling = threading.Thread(target=tell)
    telling.start()
    assert host.state(run(host, store, pre=pre)) == "complete"
    telling.join()


def test_reading_statuses_moves_nothing_and_keeps_the_readings(
    host: Host, pump: PumpProcess
) -> None:
    pump_view = a_bottle(id=DEVICE_ID, name="pump", kind="syringe_pump")
    action_id = run(host, action="read", args={}, operation=READ, resources=[pump_view])
    assert host.last(action_id)["report"]["evidence"] == {"volume_ul": 0.0, "port_index": 1}
    assert host.state(action_id) == "complete"
    assert pump.moves == []


def test_nothing_starts_while_the_host_is_not_armed_or_stopped(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    latch_stop(host.journal, StopLabFrame(stop_id=uuid4(), issued_by="ada"))
    assert host.state(run(host)) == "accepted"
    with host.journal.write() as tx:
        tx.set_meta("stop_id", None)
        tx.set_meta("armed_boot_id", "the boot before")
    with host.executor() as executor:
        assert executor.drain() == 0
    assert pump.moves == []


def test_a_line_that_is_held_does_not_read_its_queue(host: Host, pump: PumpProcess) -> None:
    """It is woken each second, and the queue may be long."""
    host.take(a_do(host.server))
    latch_stop(host.journal, StopLabFrame(stop_id=uuid4(), issued_by="ada"))
    asked: list[str] = []
    with host.executor() as executor:
        host.journal._connection.set_trace_callback(asked.append)
        assert executor.drain() == 0
        host.journal._connection.set_trace_callback(None)
    assert any("'actuated'" in query for query in asked)
    assert not any("'accepted'" in query for query in asked)
    assert pump.moves == []


def test_a_journal_that_cannot_be_written_holds_the_line(host: Host, pump: PumpProcess) -> None:
    do = a_do(host.server)
    host.take(do)
    pages = host.journal._connection.execute("PRAGMA page_count").fetchone()[0]
    host.journal._connection.execute(f"PRAGMA max_page_count = {pages}")
    filler = "x" * 100_000
    with pytest.raises(JournalError), host.journal.write() as tx:
        tx.set_meta("filler", filler)
    seal = host.journal._seal_path
    seal.rename(seal.with_suffix(".away"))  # the seal cannot be written either
    with host.executor() as executor, pytest.raises(AbandonedActionError):
        executor.drain()
    seal.with_suffix(".away").rename(seal)
    host.journal._connection.execute("PRAGMA max_page_count = 1000000")
    with host.executor() as executor:
        assert executor.drain() == 0
    assert host.state(do.action_id) == "in_doubt"  # its start is on disk, though not sealed
    assert pump.moves == []


def test_a_cancelled_running_action_is_halted_and_says_how_far_it_came(
    host: Host, pump: PumpProcess
) -> None:
    pump.tell("slow 50")
    do = a_do(host.server)
    host.take(do)
    cancel = Cancel(host_id=HOST_ID, epoch=1, dseq=host.server.next_dseq(), action_id=do.action_id)
    with host.executor() as executor:
        with host.journal.write() as tx:
            tx.want_cancel(do.action_id)
        executor.drain()
    assert host.state(do.action_id) == "aborted"
    moved_nl = host.last(do.action_id)["outcome"]["moved_nl"]
    assert 0 <= moved_nl < 100_000
    assert host.contents(SYRINGE_ID) == moved_nl
    assert host.take(cancel).answer.kind == "duplicate"


def test_the_watchdog_halts_a_device_whose_driver_does_not_come_back(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(action_execution, "outer_limit_s", lambda *_: 0.3)
    pump.tell("slow 100")
    action_id = run(host)
    assert host.state(action_id) == "in_doubt"
    assert host.last(action_id)["code"] == "edge.watchdog"


def test_after_the_watchdog_and_a_person_s_answer_the_device_works_again(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    do, later = a_do(host.server), a_do(host.server, resources=[])
    host.take(do)
    host.take(later)
    resolve = Resolve(
        host_id=HOST_ID,
        epoch=1,
        dseq=host.server.next_dseq(),
        action_id=do.action_id,
        answer="did_not",
    )
    with host.executor() as executor:
        with monkeypatch.context() as patch:
            patch.setattr(action_execution, "outer_limit_s", lambda *_: 0.3)
            pump.tell("slow 100")
            executor.drain()
        assert host.state(later.action_id) == "accepted"
        pump.tell("slow 1")
        host.take(resolve)
        executor.drain()
    assert host.state(later.action_id) == "complete"


def test_a_text_where_a_number_is_wanted_is_not_observable(host: Host, store: ValkeyStore) -> None:
    other = uuid4()
    pre = [a_condition(device_id=other, status="mode", low=1.0)]
    store.put("other", [StatusSample(str(other), "mode", 0.0, time.monotonic(), "idle")], 1)
    action_id = run(host, store, pre=pre)
    assert host.state(action_id) == "rejected"
    assert host.last(action_id)["pre"][0]["verdict"] == "unobservable"


def test_an_action_that_was_started_and_never_answered_is_in_doubt_after_a_crash(
    host: Host, pump: PumpProcess
) -> None:
    do = a_do(host.server)
    host.take(do)
    with host.journal.write() as tx:
        tx.move(do.action_id, ActionState.ACCEPTED, ActionState.STARTED)
    with host.executor() as executor:
        assert executor.drain() == 0
        assert executor.recover() == []
    assert host.kinds(do.action_id) == ["accepted", "in_doubt"]
    assert host.journal.blocked_by(DEVICE_ID) == str(do.action_id)
    assert pump.moves == []


def test_a_row_whose_text_was_changed_in_the_journal_never_starts(
    host: Host, pump: PumpProcess
) -> None:
    do = a_do(host.server)
    host.take(do)
    query = "UPDATE action SET body = replace(body, '100.0', '900.0')"
    host.journal._connection.execute(query)
    with host.executor() as executor:
        executor.drain()
    assert host.last(do.action_id)["code"] == "edge.bad_signature"
    assert pump.moves == []


def test_start_and_answer_keep_versions_and_readings_with_their_age(
    host: Host, store: ValkeyStore
) -> None:
    sample = StatusSample(str(DEVICE_ID), "volume_ul", 0.0, time.monotonic() - 2.0, 12.5)
    store.put("line", [sample], 1)
    action_id = run(host, store)
    bodies = {one.kind: one.body for one in host.events() if one.action_id == action_id}
    for kind in ("started", "actuated"):
        context = bodies[kind]["context"]
        assert context["driver_digest"] == host.device.digest
        assert len(context["config_digest"]) == 64
        (reading,) = context["environment"]
        assert (reading["device_id"], reading["value"]) == (str(DEVICE_ID), 12.5)
        assert 2.0 <= reading["age_s"] < 60.0


def test_a_lost_store_stops_no_action(host: Host) -> None:
    action_id = run(host, ValkeyStore("unix:///nowhere/valkey.sock"))
    assert host.state(action_id) == "complete"
    started = next(one for one in host.events() if one.kind == "started")
    assert started.body["context"]["environment"] == []
