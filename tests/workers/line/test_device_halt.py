"""A device whose action nobody has seen end is halted and looked at before a person is asked."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Iterator
from contextlib import closing
from uuid import uuid4

import msgspec
import pytest

from drivers.load import call_action, read_spec
from labweb.domain.errors import DeviceError
from labweb.domain.messages.commands import Cancel, Do, Resolve
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.halts.halted_setpoints import owe_halt
from tests.drivers.conformance.cases import HEATER_STIRRERS
from tests.drivers.conformance.placed_models import Bench, Case, running
from tests.workers.bench import (
    BOOT_ID,
    DEVICE_ID,
    HOST_ID,
    SYRINGE_ID,
    Host,
    PumpProcess,
    a_device,
    a_do,
    a_syringe,
    installed,
    until,
)
from tests.workers.line.crashing import accept_and_drain
from workers.base.system_clock import HostClock
from workers.journal.journal import Journal
from workers.line import device_halt
from workers.line.device_halt import LateHalts
from workers.line.device_unit import DeviceUnit
from workers.line.line_process import make_units
from workers.uplink.session import latch_stop, open_session

SET = {"rate_setpoint_ul_s": 50.0, "is_running": True, "port_index": 3}


def killed(host: Host, pump: PumpProcess) -> Do:
    """Begin a slow stroke in a process that is killed in the middle of it; return the command."""
    pump.tell("slow 200")
    do = a_do(host.server, resources=[*a_do(host.server).resources[:1], a_syringe(data=SET)])
    variables = {
        "LABWEB_BOOT_ID": BOOT_ID,
        "LABWEB_FAULTS": "1",
        "LABWEB_FAULT": "execute.mid_action@8:kill",
    }
    device_text = msgspec.json.encode(host.device)
    arguments = (host.path, device_text, host.server.sign(do), variables)
    process = multiprocessing.get_context("forkserver").Process(
        target=accept_and_drain, args=arguments
    )
    process.start()
    process.join(30)
    assert process.exitcode == -signal.SIGKILL
    assert len(pump.moves) == 1
    return do


def volume_ul(host: Host) -> float:
    """Ask the pump over a line of its own where its plunger stands."""
    unit = make_units([host.device], HostClock(), installed())[DEVICE_ID]
    unit.connect_if_due()
    try:
        return float(unit.read("volume_ul"))
    finally:
        unit.close()


def test_the_successor_of_a_killed_line_halts_the_device_and_asks_about_what_stands(
    host: Host, pump: PumpProcess
) -> None:
    do = killed(host, pump)
    with host.executor():
        told = host.last(do.action_id)
        assert host.state(do.action_id) == "in_doubt"
        assert told["message"].endswith("its device was halted, and stands")
        seen_ul = told["report"]["evidence"]["volume_ul"]
        assert 0 < seen_ul < 99
    assert volume_ul(host) == seen_ul, "what is asked about does not change any more"
    assert len(pump.moves) == 1, "a halt is no action"


def test_what_the_device_was_set_to_besides_is_unknown_after_that(
    host: Host, pump: PumpProcess
) -> None:
    device = msgspec.structs.replace(host.device, nodes={"pump": SYRINGE_ID})
    open_session(host.journal, host.server.welcome(device))
    killed(host, pump)
    with host.executor():
        pass
    event = next(one for one in host.events() if one.kind == "halted")
    assert event.body["code"] == "edge.interrupted"
    gone = {"is_running": None, "rate_setpoint_ul_s": None}
    assert event.body["data"] == {str(SYRINGE_ID): gone}
    with host.journal.write() as tx:
        held = tx.resource(SYRINGE_ID)
    assert held is not None
    assert held.view.data == {**SET, **gone}
    assert held.quarantined_by is not None
    assert held.view.rev >= event.body["revs"][str(SYRINGE_ID)]


def test_a_device_that_cannot_be_reached_may_still_move_and_the_doubt_says_so(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    do = killed(host, pump)
    pump.end()
    monkeypatch.setattr(device_halt, "REACH_S", 0.5)
    with host.executor():
        pass
    told = host.last(do.action_id)
    assert host.state(do.action_id) == "in_doubt"
    assert "may still move: it does not answer, and was not halted" in told["message"]
    assert "halted" not in host.kinds(), "nothing was halted, so nothing is unknown by that"


def is_reached(unit: DeviceUnit) -> bool:
    unit.connect_if_due()
    return unit.is_online


def late_halts(host: Host, woken: list[str]) -> LateHalts:
    return LateHalts(
        host.units, HostClock(), lambda: Journal(host.path), lambda: woken.append("line")
    )


def test_a_device_that_answers_only_later_is_halted_then_and_nothing_starts_on_it_before(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    do = killed(host, pump)
    pump.tell("mute")
    monkeypatch.setattr(device_halt, "REACH_S", 0.3)
    with host.executor():
        assert "halted" not in host.kinds()
    woken: list[str] = []
    with host.executor() as executor:  # another process of the line: it is on disk
        answer = Resolve(
            host_id=HOST_ID,
            epoch=1,
            dseq=host.server.next_dseq(),
            action_id=do.action_id,
            answer="partly",
            moved_nl=1_000,
            note="it has begun",
            issued_by="ada",
        )
        host.take(answer)
        pump.tell("talk")
        unit = host.units[DEVICE_ID]
        until(lambda: is_reached(unit))
        following = a_do(host.server, resources=[])
        host.take(following)
        assert executor.drain() == 0
        assert len(pump.moves) == 1, "it answers, and still owes a halt"
        late_halts(host, woken).look(host.journal.host_state().owes_halt)
        until(lambda: woken)
        seen_ul = unit.read("volume_ul")
        assert seen_ul < 99
        assert unit.read("volume_ul") == seen_ul, "it stands"
        pump.tell("slow 1")
        assert executor.drain() == 1
    assert len(pump.moves) == 2
    kinds = host.kinds()
    assert kinds.index("halted") < kinds.index("started", kinds.index("resolved"))
    event = next(one for one in host.events() if one.kind == "halted")
    assert event.body["message"] == "its device was halted, and stands"
    assert event.body["evidence"]["volume_ul"] == pytest.approx(seen_ul)
    assert event.body["action_id"] == str(do.action_id)


def refuse(_: DeviceUnit | None) -> None:
    raise DeviceError("busy")


def test_a_halt_that_a_device_refuses_stays_owed(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed(host, pump)
    monkeypatch.setattr(device_halt, "AGAIN_S", 0.0)
    with host.executor():
        pass
    refused: list[DeviceUnit | None] = []

    def refuse_again(unit: DeviceUnit | None) -> None:
        refused.append(unit)
        refuse(unit)

    with monkeypatch.context() as refusing:
        refusing.setattr(DeviceUnit, "halt", refuse_again)
        with host.journal.write() as tx:
            owe_halt(tx, DEVICE_ID, "edge.interrupted", None)
        with host.executor():
            late = late_halts(host, [])

            def has_refused_thrice() -> bool:
                late.look(host.journal.host_state().owes_halt)
                return len(refused) >= 3

            until(has_refused_thrice)
            assert host.journal.host_state().owes_halt == {str(DEVICE_ID)}
    with host.executor():
        late_halts(host, []).look(host.journal.host_state().owes_halt)
        until(lambda: not host.journal.host_state().owes_halt)


def test_a_stop_that_was_reset_before_its_line_came_back_is_carried_out_before_anything_acts(
    host: Host, pump: PumpProcess
) -> None:
    latch_stop(host.journal, StopLabFrame(stop_id=uuid4(), issued_by="ada"))
    with host.journal.write() as tx:
        tx.set_meta("stop_id", None)
    woken: list[str] = []
    with host.executor() as executor:
        host.take(a_do(host.server))
        until(lambda: is_reached(host.units[DEVICE_ID]))
        assert executor.drain() == 0
        assert not pump.moves, "the lab was stopped, and its device was told nothing yet"
        late_halts(host, woken).look(host.journal.host_state().owes_halt)
        until(lambda: woken)
        assert executor.drain() == 1
    found = [one.body for one in host.events() if one.kind == "halted"]
    assert [one["code"] for one in found] == ["edge.stopped"] * 2
    assert found[1]["message"] == "its device was halted, and stands"


def test_what_acts_is_stopped_by_a_stop_that_was_reset_before_its_line_looked(
    host: Host, pump: PumpProcess
) -> None:
    pump.tell("slow 50")
    do = a_do(host.server)
    host.take(do)

    def stop_and_reset() -> None:
        until(lambda: pump.moves)
        with closing(Journal(host.path)) as journal:
            latch_stop(journal, StopLabFrame(stop_id=uuid4(), issued_by="ada"))
            with journal.write() as tx:
                tx.set_meta("stop_id", None)

    with host.executor() as executor:
        stopping = threading.Thread(target=stop_and_reset)
        stopping.start()
        executor.drain()
        stopping.join()
    assert host.state(do.action_id) == "aborted"
    assert host.last(do.action_id)["outcome"]["moved_nl"] < 99_000


def test_a_cancel_that_does_not_reach_the_device_is_owed_too(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    pump.tell("slow 20")
    do = a_do(host.server)
    host.take(do)
    with host.executor() as executor:
        monkeypatch.setattr(host.units[DEVICE_ID].driver, "halt", lambda: refuse(None))
        with host.journal.write() as tx:
            tx.want_cancel(do.action_id)
        executor.drain()
        assert host.journal.host_state().owes_halt == {str(DEVICE_ID)}


def test_a_cancel_that_a_device_may_not_have_heard_is_owed_until_it_answers_a_question(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    pump.tell("mute_after_move")
    do = a_do(host.server)
    host.take(do)
    with host.executor() as executor:
        unit = host.units[DEVICE_ID]
        monkeypatch.setattr(unit.driver, "halt", lambda: None)  # sent, and never answered
        with host.journal.write() as tx:
            tx.want_cancel(do.action_id)
        executor.drain()
        assert not unit.owes_halt, "the word went out"
        assert host.journal.host_state().owes_halt == {str(DEVICE_ID)}


@pytest.fixture
def plate() -> Iterator[tuple[Bench, Case, DeviceUnit]]:
    """Connect a stirring plate, which answers questions and no command."""
    case = HEATER_STIRRERS[0]
    spec = read_spec(case.dotted)
    with running([case]) as bench:
        device = a_device(
            bench.url(case),
            module=case.dotted,
            class_name=spec.class_name,
            digest=spec.digest,
            config=case.config,
            statuses={"speed_rpm": 1.0, "temperature_c": 1.0},
        )
        (unit,) = make_units([device], HostClock(), installed()).values()
        until(lambda: is_reached(unit))
        yield bench, case, unit
        unit.close()


def test_a_device_that_answers_no_command_counts_as_halted_only_when_it_answers_a_question(
    plate: tuple[Bench, Case, DeviceUnit], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, case, unit = plate
    monkeypatch.setattr(device_halt, "STAND_S", 0.6)
    call_action(unit.driver, "stir", {"speed_rpm": 300.0})
    bench.inflict(case, "no_answer")
    found = device_halt.halt_and_look(unit, HostClock())
    assert (found.is_halted, found.is_owed) == (True, True)
    assert found.text == "its device may still move: it was told to halt, and does not answer"
    assert not unit.is_online
    bench.cure(case)
    until(lambda: is_reached(unit))
    monkeypatch.undo()
    found = device_halt.halt_and_look(unit, HostClock())
    assert (found.is_halted, found.is_owed) == (True, False)
    assert found.text == "its device was halted, and stands"


def test_a_device_that_does_not_come_to_rest_may_still_move_and_the_doubt_says_so(
    host: Host, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    do = killed(host, pump)
    pump.tell("unstoppable")
    monkeypatch.setattr(device_halt, "STAND_S", 0.6)
    with host.executor():
        pass
    message = host.last(do.action_id)["message"]
    assert "may still move: it was halted, and volume_ul did not come to rest" in message


def test_a_cancel_tells_that_the_whole_device_was_halted_before_it_tells_the_end(
    host: Host, pump: PumpProcess
) -> None:
    device = msgspec.structs.replace(host.device, nodes={"pump": SYRINGE_ID})
    open_session(host.journal, host.server.welcome(device))
    pump.tell("slow 50")
    do = a_do(host.server)
    host.take(do)
    cancel = Cancel(host_id=HOST_ID, epoch=1, dseq=host.server.next_dseq(), action_id=do.action_id)
    with host.executor() as executor:
        with host.journal.write() as tx:
            tx.want_cancel(do.action_id)
        executor.drain()
    host.take(cancel)
    kinds = host.kinds()
    assert kinds.index("halted") == kinds.index("aborted") - 1
    event = next(one for one in host.events() if one.kind == "halted")
    assert event.body["code"] == "edge.halted"
    assert event.body["action_id"] == str(do.action_id)
