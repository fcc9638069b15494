"""Two syringes that move at the same moment: both begin or none does, and both end well or none."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from uuid import UUID, uuid4, uuid5

import msgspec
import pytest

from drivers.transports.urls import line_key
from labweb.domain.crutd.operations import TransferLiquid, Update, to_json
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.errors import Effect
from labweb.domain.messages.commands import BatchPart, Cancel, Do, HostBatch
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.runs.host_journal.action_states import ActionReport, ActionState
from tests.workers.bench import (
    BOOT_ID,
    DEVICE_ID,
    HOST_ID,
    SPACE,
    SYRINGE_ID,
    Host,
    PumpProcess,
    a_device,
    a_do,
    a_syringe,
    driver_digest,
    installed,
    plain,
    until,
)
from workers.base.system_clock import HostClock
from workers.journal.journal import Journal
from workers.line.action_execution import ActionResult
from workers.line.action_files import ActionFiles
from workers.line.executor import Executor
from workers.line.line_process import make_units
from workers.uplink.session import open_session

SECOND_ID, NEXT_ID = uuid5(SPACE, "second pump"), uuid5(SPACE, "second syringe")
FULL = a_syringe(contents={"lot": 100_000})
NEXT = a_syringe(id=NEXT_ID, name="second syringe")


class Lines:
    """Two pumps, each served by a line of its own, as two processes have it."""

    def __init__(self, host: Host, second: DeviceConfig) -> None:
        self.host = host
        self.devices = {DEVICE_ID: host.device, SECOND_ID: second}
        open_session(host.journal, host.server.welcome(*self.devices.values()))
        self.batch_id = uuid4()
        self._open: dict[str, ExitStack] = {}
        self._fill()
        self.giver, self.receiver = self._members()

    def _members(self) -> tuple[Do, Do]:
        ids = uuid4(), uuid4()
        give = to_json(TransferLiquid(source_id=SYRINGE_ID, target_id=NEXT_ID, amount_nl=100_000))
        receive = to_json(Update(resource_id=NEXT_ID, data={}))
        made = []
        for place, (device_id, action, operation, volume_ul) in enumerate(
            ((DEVICE_ID, "dispense", give, 0.0), (SECOND_ID, "aspirate", receive, 100.0))
        ):
            part = BatchPart(
                batch_id=self.batch_id,
                on_disconnect="continue",
                max_offline_s=3600.0,
                meets=ids[1 - place],
            )
            do = a_do(
                self.host.server,
                action_id=ids[place],
                device_id=device_id,
                driver_digest=driver_digest(),
                action=action,
                args={"volume_ul": 100.0, "rate_ul_s": 200.0},
                operation=operation,
                resources=[],
                post=[_holds(device_id, volume_ul)],
                batch=part,
            )
            made.append(do)
        return made[0], made[1]

    def _fill(self) -> None:
        """Draw the liquid that is to be passed on."""
        self.host.take(a_do(self.host.server))
        self.drain(DEVICE_ID)

    def take(self, **changes: object) -> str:
        server = self.host.server
        members = [server.sign(one) for one in (self.giver, self.receiver)]
        batch = HostBatch(
            host_id=HOST_ID,
            epoch=server.epoch,
            dseq=self.giver.dseq,
            batch_id=self.batch_id,
            members=members,
            resources=[NEXT],
        )
        batch = msgspec.structs.replace(batch, **changes)
        return self.host.take(batch).answer.kind

    def executor(self, device_id: UUID) -> Executor:
        """Return what serves the line of a device, with a journal of its own."""
        line = line_key(self.devices[device_id].transport)
        self.end(line)
        served = [one for one in self.devices.values() if line_key(one.transport) == line]
        journal, clock = Journal(self.host.path), HostClock()
        units = make_units(served, clock, installed())
        made = Executor(
            journal,
            line,
            units,
            store=None,
            clock=clock,
            files=ActionFiles(self.host.folder / "files" / str(device_id)),
        )
        made.recover()
        for unit in units.values():
            unit.connect_if_due()
        opened = self._open[line] = ExitStack()
        opened.callback(journal.close)
        for unit in units.values():
            opened.callback(unit.close)
        opened.callback(made.close)
        return made

    def end(self, line: str) -> None:
        """End what serves a line, as its process ends."""
        if line in self._open:
            self._open.pop(line).close()

    def drain(self, *device_ids: UUID) -> None:
        """Let the lines work, each on its own thread, until none of them can go on."""
        executors = [self.executor(one) for one in device_ids]
        threads = [threading.Thread(target=one.drain) for one in executors]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def states(self) -> tuple[str, str]:
        return self.host.state(self.giver.action_id), self.host.state(self.receiver.action_id)

    def close(self) -> None:
        for line in [*self._open]:
            self.end(line)


def _holds(device_id: UUID, volume_ul: float) -> dict[str, object]:
    return plain(
        Condition(
            name="pump.syringe_volume",
            device_id=device_id,
            status="volume_ul",
            low=volume_ul,
            high=volume_ul,
            tolerance=1.0,
        )
    )


@pytest.fixture
def second_pump(tmp_path: Path) -> Iterator[PumpProcess]:
    (tmp_path / "second").mkdir()
    process = PumpProcess(tmp_path / "second")
    yield process
    process.end()


@pytest.fixture
def lines(host: Host, second_pump: PumpProcess) -> Iterator[Lines]:
    made = Lines(host, a_device(second_pump.url, id=SECOND_ID, key="second", name="Second pump"))
    yield made
    made.close()


@pytest.fixture
def bus(host: Host) -> Iterator[Lines]:
    """Both pumps on one wire, at two addresses."""
    second = a_device(
        host.url,
        id=SECOND_ID,
        key="second",
        name="Second pump",
        config={"syringe_ul": 1000.0, "address": "2"},
    )
    made = Lines(host, second)
    yield made
    made.close()


def test_both_move_at_the_same_moment_and_the_giver_ends_last(
    lines: Lines, pump: PumpProcess, second_pump: PumpProcess
) -> None:
    assert lines.take() == "accept"
    lines.drain(DEVICE_ID, SECOND_ID)
    assert lines.states() == ("complete", "complete")
    assert pump.moves == ["A300", "A0"]
    assert second_pump.moves == ["A300"]
    assert lines.host.contents(SYRINGE_ID) == 0
    assert lines.host.contents(NEXT_ID) == 100_000
    told = [(one.kind, one.action_id) for one in lines.host.events()]
    giver, receiver = lines.giver.action_id, lines.receiver.action_id
    began = told.index(("started", giver))
    assert told[began + 1] == ("started", receiver)
    assert told.index(("complete", receiver)) < told.index(("complete", giver))
    assert lines.host.journal.regression() is None


def test_two_pumps_of_one_wire_move_at_the_same_moment(bus: Lines, pump: PumpProcess) -> None:
    assert bus.take() == "accept"
    bus.drain(DEVICE_ID)
    assert bus.states() == ("complete", "complete")
    assert pump.moves[0] == "A300"
    assert sorted(pump.moves[1:]) == ["2A300", "A0"]
    assert bus.host.contents(NEXT_ID) == 100_000
    began = [one.at_s for one in bus.host.events() if one.kind == "started"][-2:]
    ended = [one.at_s for one in bus.host.events() if one.kind == "actuated"][-2:]
    assert began[1] <= ended[0], "one after the other"


def test_none_moves_while_the_other_line_is_away_and_both_do_later(
    lines: Lines, pump: PumpProcess, second_pump: PumpProcess
) -> None:
    lines.take()
    lines.drain(DEVICE_ID)
    assert lines.states() == ("accepted", "accepted")
    assert pump.moves == ["A300"]
    # What the first line read is too old to count: the second must not begin on the strength of it.
    lines.drain(SECOND_ID)
    assert lines.states() == ("accepted", "accepted")
    assert second_pump.moves == []
    lines.drain(DEVICE_ID, SECOND_ID)
    assert lines.states() == ("complete", "complete")


def test_what_fails_halts_the_other_and_nobody_knows_where_the_liquid_is(
    lines: Lines, pump: PumpProcess, second_pump: PumpProcess
) -> None:
    pump.tell("slow 200")
    second_pump.tell("mute_after_move")
    lines.take()
    lines.drain(DEVICE_ID, SECOND_ID)
    assert lines.states() == ("in_doubt", "in_doubt")
    assert lines.host.quarantine(SYRINGE_ID) == str(lines.giver.action_id)
    assert lines.host.quarantine(NEXT_ID) is not None
    assert lines.host.last(lines.giver.action_id)["report"]["code"] == "device.stopped"


def test_a_receiver_that_went_well_is_in_doubt_when_the_giver_was_not(
    lines: Lines, pump: PumpProcess
) -> None:
    pump.tell("mute_after_move")
    lines.take()
    lines.drain(DEVICE_ID, SECOND_ID)
    assert lines.states() == ("in_doubt", "in_doubt")
    assert lines.host.quarantine(NEXT_ID) is not None


def test_a_cancel_of_one_keeps_both_from_moving(
    lines: Lines, pump: PumpProcess, second_pump: PumpProcess
) -> None:
    lines.take()
    server = lines.host.server
    cancel = Cancel(
        host_id=HOST_ID,
        epoch=server.epoch,
        dseq=lines.receiver.dseq,
        action_id=lines.receiver.action_id,
    )
    lines.host.take(cancel)
    lines.drain(DEVICE_ID, SECOND_ID)
    assert lines.states() == ("rejected", "stopped")
    body = lines.host.last(lines.giver.action_id)
    assert (body["code"], body["is_given_back"]) == ("edge.partner", True)
    assert (pump.moves, second_pump.moves) == (["A300"], [])


def test_a_condition_that_fails_at_one_keeps_both_from_moving(
    lines: Lines, pump: PumpProcess, second_pump: PumpProcess
) -> None:
    lines.receiver = msgspec.structs.replace(lines.receiver, pre=[_holds(SECOND_ID, 500.0)])
    lines.take()
    lines.drain(DEVICE_ID, SECOND_ID)
    lines.drain(DEVICE_ID)
    assert lines.states() == ("rejected", "rejected")
    assert (pump.moves, second_pump.moves) == (["A300"], [])


def test_a_line_that_dies_with_both_started_halts_the_other_one(
    lines: Lines, pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process of the second line is gone when the first one starts both."""
    lines.take()
    pump.tell("slow 200")
    second = lines.executor(SECOND_ID)
    died = threading.Event()

    class DiedError(BaseException):
        pass

    def die(*_: object) -> None:
        died.set()
        raise DiedError

    def serve() -> None:
        while not died.is_set():
            second.drain()

    monkeypatch.setattr(second, "_carry_out", die)
    first = lines.executor(DEVICE_ID)
    acting = threading.Thread(target=first.drain)
    acting.start()
    with pytest.raises(BaseException):  # noqa: B017, PT011 - whatever ends its process
        serve()
    until(lambda: lines.host.state(lines.receiver.action_id) == "started")
    lines.executor(SECOND_ID)  # the process that follows puts it in doubt
    acting.join(timeout=10)
    assert lines.states() == ("in_doubt", "in_doubt")
    assert pump.moves[-1] == "A0"


def test_a_readiness_does_not_outlive_the_process_that_wrote_it(
    lines: Lines, pump: PumpProcess
) -> None:
    lines.take()
    second = lines.executor(SECOND_ID)
    waiting = threading.Thread(target=second.drain)
    waiting.start()
    until(lambda: _prestate(lines.host, lines.receiver.action_id) not in {None, "{}"})
    waiting.join()
    with lines.host.journal.write() as tx:  # as if it had been killed before it took that back
        ready = {"boot_id": BOOT_ID, "mono_s": lines.host.journal.mono_s()}
        ready |= {"scene": {"pid": 1, "driver_digest": ""}}
        accepted = ActionState.ACCEPTED
        tx.move(lines.receiver.action_id, accepted, accepted, prestate=ready)
    lines.executor(SECOND_ID)
    lines.drain(DEVICE_ID)
    assert lines.states() == ("accepted", "accepted")
    assert pump.moves == ["A300"]


def test_a_receiver_whose_giver_has_failed_sends_no_byte(
    lines: Lines, second_pump: PumpProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The giver's driver refuses at once, before the other line has seen that both are started."""
    lines.take()
    first = lines.executor(DEVICE_ID)
    refused = ActionReport(ok=False, effect=Effect.NONE, code="device.rejected", message="no")
    seal_up = Journal.seal_up

    def late(journal: Journal) -> None:
        until(lambda: lines.host.state(lines.giver.action_id) == "aborted")
        seal_up(journal)

    monkeypatch.setattr(first._watch, "carry_out_all", lambda pairs: [ActionResult(refused)])
    monkeypatch.setattr(Journal, "seal_up", late)
    second = lines.executor(SECOND_ID)
    threads = [threading.Thread(target=one.drain) for one in (first, second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert lines.states() == ("aborted", "aborted")
    assert second_pump.moves == []


def _prestate(host: Host, action_id: UUID) -> str | None:
    row = host.journal.action(action_id)
    return None if row is None else row.prestate


def test_a_pair_that_is_none_is_refused_whole(lines: Lines) -> None:
    alone = BatchPart(batch_id=lines.batch_id)
    lines.receiver = msgspec.structs.replace(lines.receiver, batch=alone)
    assert lines.take() == "refuse"
    assert lines.host.journal.actions("", ActionState.ACCEPTED) == []
    lines.giver, lines.receiver = lines._members()
    lines.receiver = msgspec.structs.replace(lines.receiver, device_id=DEVICE_ID)
    assert lines.take() == "refuse"
    assert lines.host.journal.open_ids() == []
