"""OPC UA from the driver: what is lost, what is refused, what a server says of itself."""

import asyncio
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from asyncua import Server, ua
from asyncua.common.instantiate_util import instantiate

from drivers.browse.browsed import Browsed
from drivers.browse.opcua import browse
from drivers.load import read_status
from drivers.transports.opcua.codes import LOST, REFUSED, failure
from drivers.transports.opcua.nodes import UNECE, EngineeringUnit
from drivers.transports.opcua.transport import OpcUaTransport
from drivers.transports.urls import line_key, make_transport
from labweb.domain.enrollment.driver_spec import check_arguments
from labweb.domain.errors import (
    DefinitionError,
    DeviceError,
    Effect,
    NotFoundError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.corpus import INSTRUMENTS, NO_INSTRUMENTS
from tests.drivers.conformance.cases import CONTROLLERS, TEMPER
from tests.drivers.conformance.placed_models import Bench, Doing, do, running, sent_by
from tests.fixtures.running import ROOT, until
from workers.sandbox.confinement import landlock_abi

CASE = next(case for case in CONTROLLERS if case.model == "lads_controller")
SETS = INSTRUMENTS / "opcua"


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running([CASE]) as bench:
        yield bench


def test_a_lost_session_leaves_a_running_action_in_doubt_and_a_new_one_can_be_opened(
    bench: Bench,
) -> None:
    with bench.connected(CASE, settle_s=20.0) as device:
        before = len(bench.acts(CASE, "control"))
        doing = Doing(device, TEMPER)
        until(lambda: len(bench.acts(CASE, "control")) > before)
        bench.inflict(CASE, "session_loss")
        error = doing.failure()
        assert isinstance(error, UnreachableError)
        assert error.effect is Effect.UNKNOWN
        assert "not_turned_off" in error.context
        assert bench.state(CASE)["state"] == "Running"
        device.connect()
        assert read_status(device, "temperature_c") > 20.0
        assert len(bench.acts(CASE, "control")) == before + 1


def test_a_session_that_was_lost_before_the_start_has_no_effect(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        before = len(bench.acts(CASE))
        bench.inflict(CASE, "session_loss")
        error = Doing(device, TEMPER).failure()
        assert error.effect is Effect.NONE
        assert len(bench.acts(CASE)) == before
        device.connect()


def test_an_alarm_ends_the_action_and_the_next_is_refused_until_it_is_cleared(bench: Bench) -> None:
    with bench.connected(CASE, settle_s=20.0) as device:
        doing = Doing(device, TEMPER)
        until(lambda: bench.state(CASE)["state"] == "Running")
        bench.inflict(CASE, "alarm")
        error = doing.failure()
        assert (error.code, error.effect) == ("device.alarm", Effect.PARTIAL)
        assert error.context["state"] == "Aborted"
        with pytest.raises(RejectedError, match="Aborted") as caught:
            do(device, TEMPER)
        assert caught.value.effect is Effect.NONE
        bench.cure(CASE)
        bench.inflict(CASE, "power_loss", for_s=0.5)
        until(lambda: bench.state(CASE)["state"] == "Stopped")


def test_a_running_function_gets_a_new_target_and_no_second_start(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        do(device, TEMPER)
        sent = sent_by(device)
        do(device, ("reach_temperature", {"temperature_c": 50.0, "tolerance_c": 1.0}))
        acting = [frame for frame in sent if frame.startswith((b'["write"', b'["call"'))]
        assert len(acting) == 1
        assert acting[0].endswith(b'TargetValue", 50.0]')


def test_the_range_of_the_device_is_kept(bench: Bench) -> None:
    with bench.connected(CASE, max_temperature_c=500.0) as device:
        with pytest.raises(PreconditionError, match="-20 to 120"):
            do(device, ("reach_temperature", {"temperature_c": 130.0, "tolerance_c": 1.0}))
        assert bench.state(CASE)["state"] == "Stopped"


@pytest.mark.parametrize("setting", ["device", "unit", "function"])
def test_a_name_that_is_not_there_is_refused_with_those_that_are(
    bench: Bench, setting: str
) -> None:
    device = bench.driver(CASE, **{setting: "Nobody"})
    with pytest.raises(DeviceError, match="Nobody") as caught:
        device.connect()
    assert caught.value.effect is Effect.NONE
    assert caught.value.context["names"]


@pytest.fixture
def browsed(bench: Bench) -> Browsed:
    found = opened(bench.url(CASE), lambda line: browse(line, ("DeviceSet", "Controller")))
    assert isinstance(found, Browsed)
    return found


def opened(url: str, ask: Callable[[OpcUaTransport], Any]) -> Any:  # noqa: ANN401 - what it asks
    line = make_transport(url)
    assert isinstance(line, OpcUaTransport)
    line.open()
    try:
        return ask(line)
    finally:
        line.close()


WAY = "thermostat_unit_block_temperature"


def test_a_browsed_device_has_units_ranges_and_its_methods(browsed: Browsed) -> None:
    spec = browsed.spec
    reading = spec.status(f"{WAY}_current_value_c").value
    assert (reading.type, reading.unit) == ("number", "c")
    assert (reading.minimum, reading.maximum) == (-20.0, 120.0)
    start = spec.action(f"{WAY}_control_function_state_start_with_target_value")
    assert [one.name for one in start.parameters] == ["target_value_c"]
    assert check_arguments(start, {"target_value_c": 60.0}) == []
    assert [one.code for one in check_arguments(start, {"target_value_c": 500.0})] == [
        "driver.argument_range"
    ]
    assert spec.action(f"set_{WAY}_target_value_c").recovery == "R1"
    assert spec.action(f"{WAY}_control_function_state_stop").parameters == ()
    names = {one.name for one in spec.actions} | {one.name for one in spec.statuses}
    assert set(browsed.bindings) == names
    assert f"set_{WAY}_current_value_c" not in names
    assert spec.doc == "Simulated LADS controller LC-0001"
    assert spec.findings == ()


def test_browsing_twice_gives_the_same_digest(bench: Bench, browsed: Browsed) -> None:
    again = opened(bench.url(CASE), lambda line: browse(line, ("DeviceSet", "Controller")))
    assert again.spec.digest == browsed.spec.digest


def test_a_device_that_is_not_there_is_refused_with_those_that_are(bench: Bench) -> None:
    with pytest.raises(NotFoundError) as caught:
        opened(bench.url(CASE), lambda line: browse(line, ("DeviceSet", "Other")))
    assert caught.value.context["names"] == ["Controller"]


class OddServer:
    """A server of the published library on a thread of its own, with what is hard to map."""

    def __init__(self, build: Callable[[Server], Any]) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self.port = self._do(self._start(build))

    def _do(self, work: Any) -> Any:  # noqa: ANN401 - what it returns
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(50)

    async def _start(self, build: Callable[[Server], Any]) -> int:
        self._server = Server()
        await self._server.init()
        self._server.set_endpoint("opc.tcp://127.0.0.1:0")
        self._server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        await build(self._server)
        await self._server.start()
        return int(self._server.bserver.port)

    def stop(self) -> None:
        self._do(self._server.stop())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


async def _odd(server: Server) -> None:
    own = await server.register_namespace("urn:odd")
    device = await server.nodes.objects.add_object(own, "Odd")
    await device.add_variable(own, "Bare", 1.5)
    await device.add_variable(own, "List", [1.0, 2.0])
    await device.add_variable(own, "Moment", ua.DateTime.now())
    await device.add_variable(own, "Is On", True)
    pressure = await device.add_variable(own, "Pressure", 100.0)
    await pressure.set_writable()
    unit = ua.EUInformation(
        NamespaceUri=UNECE, UnitId=0x4D4252, DisplayName=ua.LocalizedText("mbar")
    )
    await pressure.add_property(0, "EngineeringUnits", unit)
    flow = await device.add_variable(own, "Flow", 1.0)
    await flow.add_property(
        0,
        "EngineeringUnits",
        ua.EUInformation(NamespaceUri="urn:odd", UnitId=7, DisplayName=ua.LocalizedText("drops")),
    )
    argument = ua.Argument(Name="Speed", DataType=ua.NodeId(11), ValueRank=-1)
    await device.add_method(own, "Turn", lambda _parent, _speed: [], [argument])


def test_what_cannot_be_mapped_is_left_out_and_named() -> None:
    server = OddServer(_odd)
    try:
        url = f"opc.tcp://127.0.0.1:{server.port}"
        found = opened(url, lambda line: browse(line, ("Odd",))).spec
    finally:
        server.stop()
    assert {one.name for one in found.statuses} == {"is_on", "pressure_kpa"}
    assert found.actions == ()
    assert sorted((one.code, one.subject) for one in found.findings) == [
        ("browse.argument", "Odd/Turn/Speed"),
        ("browse.range", "Pressure"),
        ("browse.rank", "List"),
        ("browse.type", "Moment"),
        ("browse.unit", "Bare"),
        ("browse.unit", "Flow"),
    ]


async def _published(server: Server) -> None:
    for name in ("Di", "AMB", "IA", "Machinery", "LADS"):
        await server.import_xml(path=str(SETS / f"Opc.Ua.{name}.NodeSet2.xml"), strict_mode=False)
    names = await server.get_namespace_array()
    di = names.index("http://opcfoundation.org/UA/DI/")
    lads = names.index("http://opcfoundation.org/UA/LADS/")
    own = await server.register_namespace("urn:maker")
    devices = server.get_node(ua.NodeId(5001, di))
    sort = server.get_node(ua.NodeId(1009, lads))
    nodes = await instantiate(devices, sort, bname=ua.QualifiedName("Heater", own), idx=own)
    unit = ua.EUInformation(NamespaceUri=UNECE, UnitId=0x43454C, DisplayName=ua.LocalizedText("°C"))
    for name in ("CurrentValue", "TargetValue"):
        value = await nodes[0].get_child([ua.QualifiedName(name, lads)])
        told = {(await one.read_browse_name()).Name: one for one in await value.get_properties()}
        for key, content in (("EngineeringUnits", unit), ("EURange", ua.Range(Low=5.0, High=95.0))):
            if key in told:
                await told[key].write_value(content)
            else:
                await value.add_property(0, key, content)


@pytest.mark.slow
@pytest.mark.timeout(180)
@pytest.mark.skipif(not SETS.exists(), reason=NO_INSTRUMENTS)
def test_a_function_made_of_the_published_types_is_browsed() -> None:
    server = OddServer(_published)
    try:
        url = f"opc.tcp://127.0.0.1:{server.port}"
        found = opened(url, lambda line: browse(line, ("DeviceSet", "Heater"))).spec
    finally:
        server.stop()
    assert {"current_value_c", "target_value_c"} <= {one.name for one in found.statuses}
    (target,) = found.action("control_function_state_start_with_target_value").parameters
    assert (target.name, target.minimum, target.maximum) == ("target_value_c", 5.0, 95.0)
    # The groups of the standard show both values once more, here without unit and range.
    assert {one.subject for one in found.findings if one.code == "browse.unit"} == {
        "AlarmMonitor/LastSeverity",
        "Operational/CurrentValue",
        "Operational/TargetValue",
    }


@pytest.mark.parametrize(
    ("status", "sort", "effect"),
    [
        ("BadOutOfRange", RejectedError, Effect.NONE),
        ("BadSessionIdInvalid", UnreachableError, Effect.NONE),
        ("BadSessionNotActivated", UnreachableError, Effect.NONE),
        ("BadUnexpectedError", DeviceError, Effect.UNKNOWN),
        ("UncertainLastUsableValue", DeviceError, Effect.UNKNOWN),
    ],
)
def test_a_status_code_says_what_may_have_happened(
    status: str, sort: type[DeviceError], effect: Effect
) -> None:
    error = failure(status, "Stop", "tcp:127.0.0.1:4840")
    assert type(error) is sort
    assert error.effect is effect
    assert status in error.message


def test_every_status_code_that_is_judged_is_one_of_the_standard() -> None:
    assert {name for name in LOST | REFUSED if not hasattr(ua.StatusCodes, name)} == set()


def test_a_unit_is_known_by_its_common_code_and_only_by_it() -> None:
    assert EngineeringUnit(UNECE, 4_408_652, "anything").code == "CEL"
    assert EngineeringUnit("urn:maker", 4_408_652, "°C").code == ""


@pytest.mark.parametrize(
    "url", ["opc.tcp://host", "opc.tcp://somebody@host:4840", "opc.tcp://h:1/x?y=1"]
)
def test_an_address_that_is_not_whole_is_refused(url: str) -> None:
    with pytest.raises(DefinitionError):
        make_transport(url)


def test_devices_of_one_server_share_its_line() -> None:
    assert line_key("opc.tcp://10.0.0.7:4840/one") == "tcp:10.0.0.7:4840"


CONFINED = """
import sys
from workers.sandbox.confinement import Bounds, confine
confine(Bounds(addresses=(("127.0.0.1", int(sys.argv[1])),)))
from drivers.transports.urls import make_transport
line = make_transport(f"opc.tcp://127.0.0.1:{sys.argv[1]}")
line.open()
print(sorted(one.name for one in line.children(None)))
line.close()
"""


@pytest.mark.skipif(not landlock_abi(), reason="this kernel has no Landlock")
def test_a_confined_line_reaches_its_server(bench: Bench) -> None:
    port = bench.url(CASE).rpartition(":")[2]
    done = subprocess.run(
        [sys.executable, "-c", CONFINED, port],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "DeviceSet" in done.stdout
