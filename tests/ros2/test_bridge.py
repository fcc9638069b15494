"""The devices of a host as real ROS 2 sees them."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from uuid import UUID

import msgspec
import pytest

from drivers.catalog.inspect import PACKAGE as DRIVERS
from drivers.catalog.scan import scan
from drivers.load import read_spec
from drivers.transports.ros2.actions import ActionClient, GoalState
from drivers.transports.ros2.bus import Bus, Pending, Plain
from drivers.transports.ros2.interfaces_table import INTERFACES
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import Definitions, parse_fields
from drivers.transports.ros2.types import Types
from labweb.domain.errors import DefinitionError, RejectedError
from labweb.domain.messages.action_asks import ActionAsk, AskTold, WithdrawAsk
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from tests.ros2.conftest import SHARE, Peer
from tests.workers.bench import DEVICE_ID, HOST_ID, Server, a_device
from workers.base.config import HostConfig, Ros2Config, ValkeyConfig, load_config
from workers.base.valkey_store import ASKS, ASKS_TOLD, StatusSample, ValkeyStore
from workers.journal.journal import Journal, create_journal
from workers.ros2.__main__ import files_of
from workers.ros2.bridge import Bridge
from workers.ros2.mapping import action_name, action_text, parameter_value, parameters_of
from workers.uplink.host_reports import BridgeWish
from workers.uplink.session import open_session

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

HEATER = "drivers.processing.ika_rct_digital"
RATE_HZ = 40.0
WAIT_S = 40.0


def a_heater() -> DeviceConfig:
    spec = read_spec(HEATER)
    return a_device(
        "tcp://127.0.0.1:9",
        key="heater-1",
        module=HEATER,
        class_name=spec.class_name,
        digest=spec.digest,
        config={},
        statuses={"temperature_c": 0.5, "speed_rpm": 0.5},
    )


class Sampling:
    """Keeps the latest values fresh, as a line does."""

    def __init__(self, store: ValkeyStore) -> None:
        self.store = store
        self.value: float | None = 21.5
        self.ending = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self) -> None:
        count = 0
        while not self.ending.wait(0.2):
            count += 1
            if self.value is not None:
                at_s, mono_s = time.time(), time.monotonic()
                sample = StatusSample(str(DEVICE_ID), "temperature_c", at_s, mono_s, self.value)
                self.store.put("line", [sample], count)


@pytest.fixture
def config(tmp_path: Path, valkey_socket: Path, domain: int) -> HostConfig:
    found = HostConfig(
        host_id=HOST_ID,
        name="bench",
        server_url="ws://127.0.0.1:9",
        data_dir=str(tmp_path),
        key_file=str(tmp_path / "key"),
        valkey=ValkeyConfig(socket=str(valkey_socket)),
        ros2=Ros2Config(domain=domain, namespace="/bench", rate_hz=RATE_HZ, has_goals=True),
    )
    create_journal(found.journal_path, HOST_ID)
    journal = Journal(found.journal_path)
    open_session(journal, Server().welcome(a_heater()))
    journal.close()
    return found


@pytest.fixture
def sampling(store: ValkeyStore) -> Iterator[Sampling]:
    found = Sampling(store)
    yield found
    found.ending.set()
    found.thread.join()


@pytest.fixture
def bridge(config: HostConfig, sampling: Sampling) -> Iterator[Bridge]:
    assert config.ros2 is not None
    found = Bridge(config, config.ros2)
    thread = threading.Thread(target=found.run, daemon=True)
    thread.start()
    yield found
    found.stop()
    thread.join(timeout=20)


def until(is_true: Callable[[], Any]) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not is_true():
        assert time.monotonic() < deadline_s, "it did not come about"
        time.sleep(0.02)


def test_a_status_reaches_a_real_node_at_the_rate_that_is_set(
    peer: Peer, bridge: Bridge, sampling: Sampling
) -> None:
    found = peer.ask(
        "listen", topic="/bench/heater_1/temperature_c", type="std_msgs/msg/Float64", count=80
    )["found"]
    assert len(found) >= 80
    assert {message["data"] for _, message in found} == {21.5}
    rate_hz = 60 / (found[-1][0] - found[-61][0])
    assert 0.5 * RATE_HZ < rate_hz < 1.5 * RATE_HZ


def test_a_value_that_is_stale_is_not_told(peer: Peer, bridge: Bridge, sampling: Sampling) -> None:
    topic, kind = "/bench/heater_1/temperature_c", "std_msgs/msg/Float64"
    assert peer.ask("listen", topic=topic, type=kind, count=1)["found"]
    sampling.value = None
    time.sleep(3.0)
    assert peer.ask("listen", topic=topic, type=kind, count=1, wait_s=1.0)["found"] == []


def test_settings_are_parameters_that_a_real_node_reads_and_does_not_change(
    peer: Peer, bridge: Bridge
) -> None:
    known = parameters_of(read_spec(HEATER), {})
    names = sorted(known)
    found = peer.ask("parameters", node="/bench/heater_1", names=names)
    assert sorted(found["listed"]["result"]["names"]) == names
    for name, value in zip(names, found["values"]["values"], strict=True):
        assert value["type"] == known[name][0]["type"]
        if value["type"] == 3:
            assert value["double_value"] == known[name][0]["double_value"]
    assert all(one["read_only"] for one in found["described"]["descriptors"])
    assert not found["changed"]["results"][0]["successful"]
    assert "server" in found["changed"]["results"][0]["reason"]


def test_a_device_is_a_node_with_an_action_for_each_thing_it_does(
    peer: Peer, bridge: Bridge
) -> None:
    goals = "/bench/heater_1/heat_to/_action/send_goal"
    until(lambda: ["heater_1", "/bench"] in peer.ask("graph")["nodes"])
    until(lambda: goals in peer.ask("graph")["services"])
    graph = peer.ask("graph")
    assert graph["topics"]["/bench/heater_1/temperature_c"] == ["std_msgs/msg/Float64"]
    kind = action_name(read_spec(HEATER), read_spec(HEATER).action("heat_to"))
    assert graph["services"][goals] == [f"{kind}_SendGoal"]


@pytest.fixture
def heat_to(bridge: Bridge, config: HostConfig) -> Iterator[ActionClient]:
    assert config.ros2 is not None
    spec = read_spec(HEATER)
    action = spec.action("heat_to")
    kind = action_name(spec, action)
    types = Types(Definitions(INTERFACES, {kind: action_text(action)}))
    bus = Bus(LinkSettings(domain=config.ros2.domain), types)
    client = ActionClient(bus, "/bench/heater_1/heat_to", types.definitions.action(kind))
    client.wait(WAIT_S)
    yield client
    bus.close()


def a_word(store: ValkeyStore) -> ActionAsk | WithdrawAsk:
    """Wait for what the bridge hands to the uplink."""
    found: list[bytes] = []

    def take() -> list[bytes]:
        found.extend(store.take_words(ASKS))
        return found

    until(take)
    return msgspec.json.decode(found[0], type=BridgeWish).frame


def tell(store: ValkeyStore, ask_id: UUID, state: str, **rest: Any) -> None:  # noqa: ANN401 - any field
    store.put_word(ASKS_TOLD, msgspec.json.encode(AskTold(ask_id=ask_id, state=state, **rest)))


class Sending:
    """Sends a goal on a thread, for its answer waits for the server's."""

    def __init__(self, client: ActionClient, goal: Plain) -> None:
        self.heard: list[Plain] = []
        self.id = b""
        self.error: Exception | None = None
        self.client = client
        self.thread = threading.Thread(target=self.run, args=(goal,), daemon=True)
        self.thread.start()

    def run(self, goal: Plain) -> None:
        try:
            self.id = self.client.begin(goal, self.heard.append, WAIT_S)
        except RejectedError as error:
            self.error = error

    def end(self) -> tuple[GoalState, Plain]:
        def slowly(pending: Pending) -> Plain | None:
            return pending.wait(0.05)

        return self.client.await_result(self.id, WAIT_S, slowly)


HEAT = {"temperature_c": 60.0, "tolerance_c": 2.0}


def test_a_goal_is_a_wish_to_the_server_and_ends_as_its_run_does(
    heat_to: ActionClient, store: ValkeyStore
) -> None:
    sending = Sending(heat_to, HEAT)
    ask = a_word(store)
    assert isinstance(ask, ActionAsk)
    assert (ask.device_id, ask.action, ask.args) == (DEVICE_ID, "heat_to", HEAT)
    tell(store, ask.ask_id, "awaiting_approval", run_number=7)
    sending.thread.join(WAIT_S)
    assert UUID(bytes=sending.id) == ask.ask_id
    tell(store, ask.ask_id, "running", run_number=7)
    until(lambda: any(one["state"] == "running" for one in sending.heard))
    told = {"temperature_c": 60.1}
    tell(store, ask.ask_id, "complete", is_final=True, run_number=7, evidence=told)
    state, result = sending.end()
    assert state is GoalState.SUCCEEDED
    assert (result["state"], result["run_number"]) == ("complete", 7)
    assert json.loads(result["evidence"]) == told


def test_a_cancelled_goal_withdraws_the_wish(heat_to: ActionClient, store: ValkeyStore) -> None:
    sending = Sending(heat_to, HEAT)
    ask = a_word(store)
    assert isinstance(ask, ActionAsk)
    tell(store, ask.ask_id, "queued", run_number=8)
    sending.thread.join(WAIT_S)
    assert heat_to.cancel(sending.id, WAIT_S)
    assert a_word(store) == WithdrawAsk(epoch=0, ask_id=ask.ask_id)
    tell(store, ask.ask_id, "stopped", is_final=True, run_number=8)
    assert sending.end()[0] is GoalState.CANCELED


def test_a_goal_that_the_server_refuses_is_not_accepted(
    heat_to: ActionClient, store: ValkeyStore
) -> None:
    sending = Sending(heat_to, HEAT)
    tell(store, a_word(store).ask_id, "refused", is_final=True, message="off")
    sending.thread.join(WAIT_S)
    assert isinstance(sending.error, RejectedError)


def test_a_goal_that_does_not_fit_the_action_never_leaves_the_host(
    heat_to: ActionClient, store: ValkeyStore
) -> None:
    with pytest.raises(RejectedError):
        heat_to.begin({"temperature_c": 1e9, "tolerance_c": 1.0}, lambda _: None, WAIT_S)
    assert store.take_words(ASKS) == []


def test_a_goal_that_nobody_answers_is_refused_and_withdrawn(
    heat_to: ActionClient, store: ValkeyStore
) -> None:
    sending = Sending(heat_to, HEAT)
    ask = a_word(store)
    sending.thread.join(WAIT_S)
    assert isinstance(sending.error, RejectedError)
    assert a_word(store) == WithdrawAsk(epoch=0, ask_id=ask.ask_id)
    tell(store, ask.ask_id, "queued")
    assert a_word(store) == WithdrawAsk(epoch=0, ask_id=ask.ask_id), "it came too late"


def test_ros_reads_the_package_of_our_actions_as_we_do(ros_python: Path, tmp_path: Path) -> None:
    files = files_of(scan(DRIVERS).drivers)
    texts = {Path(path).stem: text for path, text in files.items() if path.endswith(".action")}
    assert len(texts) > 50
    assert not any("Aspirate" in name for name in texts), "what moves liquid is a transfer's"
    script = """
import json, sys
from rosidl_adapter.parser import parse_action_string
found = {}
for name, text in json.load(sys.stdin).items():
    spec = parse_action_string("labweb_interfaces", name, text)
    found[name] = [[[f.name, str(f.type)] for f in part.fields]
                   for part in (spec.goal, spec.result, spec.feedback)]
print(json.dumps(found))
"""
    done = subprocess.run(
        [str(ros_python), "-c", script],
        input=json.dumps(texts),
        capture_output=True,
        text=True,
        check=True,
    )
    read = json.loads(done.stdout)
    for name, text in texts.items():
        for section, theirs in zip(text.split("---"), read[name], strict=True):
            ours = parse_fields(section, "labweb_interfaces", name)
            written = [
                [one.name, one.type + (f"[<={one.most}]" if one.most else "")] for one in ours
            ]
            assert written == theirs


def test_our_table_says_what_ros_has_installed(ros_python: Path) -> None:
    for name, text in INTERFACES.items():
        package, sort, _ = name.split("/")
        path = SHARE / f"{name}.{sort}"
        if package == "tf2_msgs":
            assert not path.exists(), "compare it"
            continue
        theirs = path.read_text().split("---")
        for ours, their in zip(text.split("---"), theirs, strict=True):
            assert parse_fields(ours, package, name) == parse_fields(their, package, name)


def test_secrets_are_no_parameters() -> None:
    spec = read_spec("drivers.characterization.neware_bts")
    assert "password" in {one.name for one in spec.config}
    assert "password" not in parameters_of(spec, {"password": "x"})


def test_a_setting_that_is_not_set_has_no_type() -> None:
    spec = read_spec(HEATER)
    assert parameter_value(spec.config[0], None) == {"type": 0}


def test_a_rate_outside_10_to_100_is_refused(tmp_path: Path, config: HostConfig) -> None:
    assert config.ros2 is not None
    path = tmp_path / "host.json"
    for rate_hz in (9.0, 101.0):
        ros2 = msgspec.structs.replace(config.ros2, rate_hz=rate_hz)
        path.write_bytes(msgspec.json.encode(msgspec.structs.replace(config, ros2=ros2)))
        with pytest.raises(DefinitionError, match="10 to 100"):
            load_config(path)
