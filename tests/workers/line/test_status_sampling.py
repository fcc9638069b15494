"""Sampling, the latest values, and the way back to a device that was away."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from uuid import UUID, uuid4

import msgspec
import pytest

from drivers.load import read_spec
from labweb.domain.crutd.pre_and_postconditions import Condition, ConditionVerdict
from labweb.domain.errors import EnrollmentError, StateError
from labweb.domain.messages.stops import StopLabFrame
from tests.drivers.wire import answering
from tests.workers.bench import DEVICE_ID, HOST_ID, Host, PumpProcess, a_device, installed, until
from workers.base.config import HostConfig, ValkeyConfig
from workers.base.host_key import load_key
from workers.base.host_lock import lock_host
from workers.base.system_clock import HostClock
from workers.base.valkey_store import ValkeyStore
from workers.host.__main__ import main
from workers.journal.journal import Journal, create_journal
from workers.journal.journal_reset import reset_journal
from workers.line import line_process
from workers.line.condition_readings import ConditionReader
from workers.line.device_halt import LateHalts
from workers.line.device_unit import DeviceUnit
from workers.line.line_process import StopWatch, make_units
from workers.line.status_sampling import Sampler
from workers.uplink.session import latch_stop


def a_config(folder: Path, valkey_socket: Path) -> HostConfig:
    return HostConfig(
        host_id=HOST_ID,
        name="bench",
        server_url="ws://127.0.0.1:9",
        broker_url="memory://",
        data_dir=str(folder),
        key_file=str(folder / "key"),
        valkey=ValkeyConfig(socket=str(valkey_socket)),
    )


def test_each_status_is_sampled_and_kept_as_latest_value(
    host: Host, pump: PumpProcess, store: ValkeyStore
) -> None:
    units = make_units([host.device], HostClock(), installed())
    sampler = Sampler(host.line, units, store, HostClock())
    samples = sampler.sample_once()
    assert {one.status for one in samples} == {"volume_ul", "port_index"}
    latest = store.latest(DEVICE_ID, "port_index")
    assert latest is not None
    assert latest.value == 1
    assert host.line in store.alive()
    units[DEVICE_ID].close()


def test_another_line_sees_at_once_how_an_act_has_left_a_device(
    host: Host, pump: PumpProcess, store: ValkeyStore
) -> None:
    clock = HostClock()
    units = make_units([host.device], clock, installed())
    Sampler(host.line, units, store, clock).sample_once()
    at_port = Condition(name="at", device_id=DEVICE_ID, status="port_index", equals=3)
    elsewhere = ConditionReader({}, store, clock)
    assert elsewhere.read([at_port]) == {(DEVICE_ID, "port_index"): 1}
    units[DEVICE_ID].act("select_port", {"port_index": 3})
    assert elsewhere.read([at_port]) == {(DEVICE_ID, "port_index"): 1}
    batches = store.last_key()
    judged = ConditionReader(units, store, clock).await_all([at_port], {}, is_over=lambda: False)
    assert judged is not None
    assert [result.verdict for _, result in judged] == [ConditionVerdict.PASS]
    assert elsewhere.read([at_port]) == {(DEVICE_ID, "port_index"): 3}
    assert store.last_key() == batches  # the uplink is told by samples alone
    units[DEVICE_ID].close()


def test_a_silent_device_goes_offline_and_comes_back(host: Host, pump: PumpProcess) -> None:
    device = msgspec.structs.replace(host.device, statuses={"port_index": 0.05})
    units = make_units([device], HostClock(), installed())
    sampler = Sampler(host.line, units, None, HostClock())
    sampler.start()
    unit = units[DEVICE_ID]
    until(lambda: unit.is_online)
    pump.tell("mute")
    until(lambda: not unit.is_online)
    pump.tell("talk")
    until(lambda: unit.is_online)
    sampler.stop()
    unit.close()


def test_a_device_that_cannot_tell_stays_online_and_leaves_a_gap() -> None:
    module = "drivers.connectors.chemputer_valve"
    spec = read_spec(module)
    answers = {b"read_config\0": b"VALVE_CFG 0\0", b"read_errors\0": b"ERRORS: 0\0"}
    with answering(lambda request: answers.get(request, b"")) as port:
        device = a_device(
            f"tcp://127.0.0.1:{port}",
            module=module,
            class_name=spec.class_name,
            digest=spec.digest,
            config={},
            statuses={"port_index": 0.01},
        )
        units = make_units([device], HostClock(), installed())
        unit = units[DEVICE_ID]
        sampler = Sampler(unit.line, units, None, HostClock())
        for _ in range(5):
            assert list(sampler.sample_once()) == []
            HostClock().wait(0.02)
        assert unit.is_online
        unit.close()


def test_a_valkey_that_is_away_costs_samples_and_nothing_else(
    host: Host, pump: PumpProcess
) -> None:
    away = ValkeyStore("unix:///nowhere/at/all?db=0")
    units = make_units([host.device], HostClock(), installed())
    sampler = Sampler(host.line, units, away, HostClock())
    assert len(sampler.sample_once()) == 2
    assert away.latest(DEVICE_ID, "port_index") is None
    assert not away.announce_stop(host.line)
    units[DEVICE_ID].close()


def test_the_latch_stops_every_device_and_its_release_frees_them(
    host: Host, pump: PumpProcess, valkey_socket: Path
) -> None:
    units = make_units([host.device], HostClock(), installed())
    unit = units[DEVICE_ID]
    unit.connect_if_due()
    watch = a_watch(host, valkey_socket, units)
    watch.start()
    latch_stop(host.journal, StopLabFrame(stop_id=uuid4(), issued_by="ada"))
    until(lambda: unit.driver.is_stopped)
    with host.journal.write() as tx:
        tx.set_meta("stop_id", None)
    until(lambda: not unit.driver.is_stopped)
    watch.stop()
    unit.close()


def a_watch(host: Host, valkey_socket: Path, units: dict[UUID, DeviceUnit]) -> StopWatch:
    late = LateHalts(units, HostClock(), lambda: Journal(host.path), lambda: None)
    config = a_config(host.folder, valkey_socket)
    return StopWatch(config, host.line, units, threading.Event(), late)


def test_a_device_that_a_stop_has_not_reached_is_halted_after_the_reset_before_it_acts(
    host: Host, pump: PumpProcess, valkey_socket: Path
) -> None:
    units = make_units([host.device], HostClock(), installed())
    unit = units[DEVICE_ID]
    watch = a_watch(host, valkey_socket, units)
    watch.start()
    latch_stop(host.journal, StopLabFrame(stop_id=uuid4(), issued_by="ada"))
    until(lambda: unit.owes_halt)
    with host.journal.write() as tx:
        tx.set_meta("stop_id", None)
    until(lambda: not unit.driver.is_stopped)
    assert host.journal.host_state().owes_halt == {str(DEVICE_ID)}
    unit.connect_if_due()
    until(lambda: not host.journal.host_state().owes_halt)
    told = [one.body["code"] for one in host.events() if one.kind == "halted"]
    assert told == ["edge.stopped"] * 2, "with the latch, and when it was reached"
    watch.stop()
    unit.close()


def test_a_device_that_a_word_without_a_latch_has_not_reached_owes_its_halt_too(
    host: Host,
    pump: PumpProcess,
    valkey_socket: Path,
    store: ValkeyStore,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The disk refused the latch: the word alone was heard, and the device was away."""
    monkeypatch.setattr(line_process, "BELIEVE_S", 0.5)
    units = make_units([host.device], HostClock(), installed())
    unit = units[DEVICE_ID]
    watch = a_watch(host, valkey_socket, units)
    watch.start()
    until(lambda: store.announce_stop(host.line))
    until(lambda: unit.owes_halt)
    until(lambda: not unit.driver.is_stopped)
    assert host.journal.host_state().owes_halt == {str(DEVICE_ID)}
    watch.stop()
    unit.close()


def test_a_key_is_made_once_and_kept_from_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "host.key"
    assert main(["keygen", "--out", str(path)]) == 0
    assert capsys.readouterr().out.strip() == load_key(path).public_base64
    assert main(["keygen", "--out", str(path)]) == 1
    assert path.stat().st_mode & 0o777 == 0o600
    path.chmod(0o644)
    with pytest.raises(EnrollmentError, match="0600"):
        load_key(path)


def test_a_journal_is_set_aside_only_while_the_host_does_not_run(
    tmp_path: Path, valkey_socket: Path
) -> None:
    config = a_config(tmp_path, valkey_socket)
    first = create_journal(config.journal_path, HOST_ID)
    lock = lock_host(config)
    with pytest.raises(StateError, match="runs already"):
        reset_journal(config)
    os.close(lock)
    aside = reset_journal(config)
    assert (aside / "journal.sqlite3").is_file()
    assert create_journal(config.journal_path, HOST_ID) != first
    fresh = Journal(config.journal_path)
    assert fresh.regression() is None
    fresh.close()
