"""SiLA 2 from the driver: what a definition says, what errors say, and a simulated controller."""

import base64
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sila2.server import SilaServer
from sila2.server.encryption import generate_self_signed_certificate

from drivers.load import read_status
from drivers.processing.sila_temperature_controller import (
    CONTROL,
    FEATURE,
    READING,
    TARGET,
    SilaTemperatureController,
)
from drivers.transports.sila.features import Value, parse_feature
from drivers.transports.sila.link import SilaLink
from drivers.transports.sila.messages import Messages, fill, plain
from drivers.transports.sila.transport import SilaTransport
from drivers.transports.urls import file_of, line_key, make_transport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.corpus import INSTRUMENTS, NO_INSTRUMENTS
from tests.drivers.conformance.cases import CONTROLLERS, TEMPER
from tests.drivers.conformance.placed_models import (
    Bench,
    Doing,
    a_free_port,
    do,
    impatient,
    running,
)
from tests.fixtures.running import ROOT, until
from workers.sandbox.confinement import landlock_abi

CASE = next(case for case in CONTROLLERS if case.model == "sila_controller")
PUBLISHED = INSTRUMENTS / "sila2/org/silastandard/examples/TemperatureController.sila.xml"


def definition(unit: str = "Kelvin", *, factor: float = 1.0, limits: str = "") -> str:
    """Write a definition as the language has it; its words are not those of the published one."""
    kelvin = (
        f"<Unit><Label>u</Label><Factor>{factor}</Factor><Offset>0</Offset><UnitComponent>"
        f"<SIUnit>{unit}</SIUnit><Exponent>1</Exponent></UnitComponent></Unit>"
    )

    def number(more: str) -> str:
        return (
            "<DataType><Constrained><DataType><Basic>Real</Basic></DataType>"
            f"<Constraints>{kelvin}{more}</Constraints></Constrained></DataType>"
        )

    return (
        '<Feature xmlns="http://www.sila-standard.org" SiLA2Version="1.0" FeatureVersion="1.2" '
        'Originator="org.silastandard" Category="examples">'
        "<Identifier>TemperatureController</Identifier>"
        f"<Command><Identifier>{CONTROL}</Identifier><Observable>Yes</Observable><Parameter>"
        f"<Identifier>{TARGET}</Identifier>{number(limits)}</Parameter></Command>"
        f"<Property><Identifier>{READING}</Identifier><Observable>Yes</Observable>{number('')}"
        "</Property></Feature>"
    )


RANGE = "<MaximalInclusive>363.0</MaximalInclusive><MinimalExclusive>277.0</MinimalExclusive>"


def test_a_definition_is_read_with_unit_and_range() -> None:
    feature = parse_feature(definition(limits=RANGE))
    assert feature.id == FEATURE
    assert feature.service == (
        "sila2.org.silastandard.examples.temperaturecontroller.v1.TemperatureController"
    )
    target = feature.commands[CONTROL].parameters[0]
    assert (target.basic, target.high) == ("Real", 363.0)
    assert target.low is not None
    assert 277.0 < target.low < 277.0 + 1e-9
    assert target.unit is not None
    assert target.unit.components == (("Kelvin", 1),)
    assert feature.properties[READING].is_observable


@pytest.mark.skipif(not PUBLISHED.exists(), reason=NO_INSTRUMENTS)
def test_the_published_definition_has_what_the_driver_asks_for() -> None:
    feature = parse_feature(PUBLISHED.read_text("utf-8"))
    assert feature.id == FEATURE
    command = feature.commands[CONTROL]
    assert command.is_observable
    assert [one.name for one in command.parameters] == [TARGET]
    assert command.errors == ("TemperatureNotReachable", "ControlInterrupted")
    assert command.parameters[0].high == 363.0
    assert feature.properties[READING].is_observable


@pytest.mark.parametrize(
    "text",
    [
        "",
        "<Feature/>",
        '<!DOCTYPE a [<!ENTITY b "c">]>' + definition(),
        definition().replace("TemperatureController<", "../../etc<"),
        definition().replace('Originator="org.silastandard"', 'Originator="a/b"'),
        definition(factor=float("nan")).replace("nan", "much"),
    ],
)
def test_a_definition_that_is_none_is_a_frame_error(text: str) -> None:
    with pytest.raises(FrameError):
        parse_feature(text)


def test_messages_have_the_bytes_of_the_framework() -> None:
    messages = Messages()
    made = messages.of([Value(TARGET, "Real")])
    # field 1, a message of 9 bytes: field 1, a double
    data = fill(made, {TARGET: 300.0}).SerializeToString()
    assert data == bytes.fromhex("0a09 09 0000000000c07240")
    assert plain(made.FromString(data), TARGET) == 300.0
    number = messages.framework("CommandConfirmation").FromString(b"\x0a\x03\x0a\x01x")
    assert plain(number, "commandExecutionUUID") == "x"


@pytest.mark.parametrize(
    ("told", "sort", "effect", "text"),
    [
        (b"\x0a\x08\x0a\x01p\x12\x03bad", RejectedError, Effect.NONE, "p was refused: bad"),
        (b"\x22\x00", RejectedError, Effect.NONE, "not accepted"),
        (b"\x12\x0a\x0a\x03a/E\x12\x03hot", DeviceError, Effect.UNKNOWN, "E: hot"),
        (b"\x1a\x05\x0a\x03odd", DeviceError, Effect.UNKNOWN, "odd"),
        (b"\xff\xff", FrameError, Effect.UNKNOWN, "cannot be read"),
    ],
)
def test_an_error_says_what_may_have_happened(
    told: bytes, sort: type[DeviceError], effect: Effect, text: str
) -> None:
    link = SilaLink("127.0.0.1:1", "tcp:127.0.0.1:1", 1.0, None)
    error = link._told_failure(base64.b64encode(told).decode(), "it")
    assert (type(error), error.effect) == (sort, effect)
    assert text in error.message
    assert type(link._told_failure("no base64!", "it")) is FrameError


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running([CASE]) as bench:
        yield bench


def test_a_target_is_reached_in_the_units_of_the_lab(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        do(device, TEMPER)
        assert bench.state(CASE)["target_k"] == pytest.approx(333.15)
        assert abs(read_status(device, "temperature_c") - 60.0) < 5.0
        do(device, ("stop_control", {}))
        assert bench.state(CASE)["target_k"] == pytest.approx(295.15)


def test_the_range_of_the_server_is_kept(bench: Bench) -> None:
    with bench.connected(CASE, max_temperature_c=500.0) as device:
        before = len(bench.acts(CASE))
        with pytest.raises(PreconditionError, match=r"3\.85 to 89\.85"):
            do(device, ("reach_temperature", {"temperature_c": 95.0, "tolerance_c": 1.0}))
        assert len(bench.acts(CASE)) == before


def test_a_rest_temperature_that_the_server_does_not_take_is_not_connected(bench: Bench) -> None:
    device = bench.driver(CASE, rest_temperature_c=0.0)
    with pytest.raises(RejectedError, match="rest temperature is 0") as caught:
        device.connect()
    assert caught.value.effect is Effect.NONE
    assert not device.transport.is_open


def test_a_target_that_somebody_else_sets_ends_the_action(bench: Bench) -> None:
    with bench.connected(CASE, settle_s=20.0) as device:
        assert isinstance(device, SilaTemperatureController)
        before = len(bench.acts(CASE, "control"))
        doing = Doing(device, ("reach_temperature", {"temperature_c": 80.0, "tolerance_c": 1.0}))
        until(lambda: len(bench.acts(CASE, "control")) > before)
        device.transport.begin(device._feature, CONTROL, {TARGET: 300.0})
        error = doing.failure()
        assert (error.code, error.effect) == ("device.alarm", Effect.PARTIAL)
        assert "ControlInterrupted" in error.message
        assert "temperature_c" in error.context


def test_a_lost_answer_is_unknown_and_the_command_is_not_begun_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, CASE)
    with bench.connected(CASE) as device:
        begun: list[bytes] = []

        def lose(way: str, data: bytes) -> None:
            if way == "out" and data.startswith(b'["begin"'):
                begun.append(data)
                bench.inflict(CASE, "no_answer", executes=True)

        device.transport.observer = lose
        error = Doing(device, TEMPER).failure()
        device.transport.observer = None
        assert error.effect is Effect.UNKNOWN
        assert sum(b"333.15" in frame for frame in begun) == 1
        assert "not_turned_off" in error.context


def test_silence_is_a_timeout(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    impatient(monkeypatch, CASE)
    with bench.connected(CASE) as device:
        bench.inflict(CASE, "no_answer")
        with pytest.raises(DeviceTimeoutError) as caught:
            read_status(device, "temperature_c")
        assert caught.value.effect is Effect.NONE


def test_a_feature_that_is_not_there_is_told_with_those_that_are(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        assert isinstance(device.transport, SilaTransport)
        with pytest.raises(RejectedError) as caught:
            device.transport.feature("org.silastandard/examples/Nothing/v1")
        assert FEATURE in caught.value.context["features"]


@pytest.mark.parametrize(
    "text",
    [
        definition("Second", limits=RANGE),
        definition(factor=0.5, limits=RANGE),
        definition(),
        definition(limits=RANGE).replace(TARGET, "Goal"),
    ],
)
def test_a_feature_in_other_units_or_without_range_is_refused(text: str) -> None:
    transport = make_transport("sila+local://127.0.0.1:1")
    assert isinstance(transport, SilaTransport)
    transport._features = {FEATURE: parse_feature(text)}
    device = SilaTemperatureController(
        transport, {"rest_temperature_c": 20.0, "max_temperature_c": 80.0}
    )
    with pytest.raises(RejectedError):
        device.identify()


# -- encryption


@pytest.fixture(scope="module")
def encrypted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[int, Path]]:
    """Run a server of the public library, with the certificate that it signs itself."""
    server = SilaServer(
        server_name="Bare",
        server_type="TestServer",
        server_description="It has nothing but what every server has.",
        server_version="1.0",
        server_vendor_url="https://example.org",
    )
    port = a_free_port()
    key, certificate = generate_self_signed_certificate(server.server_uuid, "127.0.0.1")
    server.start("127.0.0.1", port, private_key=key, cert_chain=certificate, enable_discovery=False)
    file = tmp_path_factory.mktemp("ca") / "server.pem"
    file.write_bytes(certificate)
    yield port, file
    server.stop(0.1)


def test_a_server_is_known_by_the_certificate_that_it_signed(encrypted: tuple[int, Path]) -> None:
    port, file = encrypted
    line = make_transport(f"sila://127.0.0.1:{port}?ca={file}")
    assert isinstance(line, SilaTransport)
    line.open()
    try:
        assert line.features == ("org.silastandard/core/SiLAService/v1",)
        assert line.read(line.feature(line.features[0]), "ServerName") == "Bare"
    finally:
        line.close()


@pytest.mark.parametrize("form", ["sila://127.0.0.1:{}", "sila+local://127.0.0.1:{}"])
def test_a_server_whose_certificate_is_not_known_is_not_talked_to(
    encrypted: tuple[int, Path], form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, CASE)
    line = make_transport(form.format(encrypted[0]))
    with pytest.raises(UnreachableError) as caught:
        line.open()
    assert caught.value.effect is Effect.NONE
    assert not line.is_open


def test_a_certificate_that_is_not_there_is_told() -> None:
    with pytest.raises(UnreachableError, match="certificate"):
        make_transport("sila://127.0.0.1:1?ca=/nowhere/server.pem").open()


def test_devices_of_one_server_share_its_line() -> None:
    assert line_key("sila://10.0.0.7:50052?ca=/a/b.pem") == "tcp:10.0.0.7:50052"
    assert file_of("sila://10.0.0.7:50052?ca=/a/b.pem") == "/a/b.pem"
    assert file_of("sila+local://127.0.0.1:50052") is None


CONFINED = """
import sys
from pathlib import Path
from workers.sandbox.confinement import Bounds, confine
confine(Bounds(addresses=(("127.0.0.1", int(sys.argv[1])),), readable=(Path(sys.argv[2]),)))
from drivers.transports.urls import make_transport
line = make_transport(f"sila://127.0.0.1:{sys.argv[1]}?ca={sys.argv[2]}")
line.open()
print(line.read(line.feature(line.features[0]), "ServerName"))
line.close()
"""


@pytest.mark.skipif(not landlock_abi(), reason="this kernel has no Landlock")
def test_a_confined_line_reaches_its_server(encrypted: tuple[int, Path]) -> None:
    environment: dict[str, Any] = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", CONFINED, *map(str, encrypted)],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Bare" in done.stdout
