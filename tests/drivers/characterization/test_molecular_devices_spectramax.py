"""The plate reader on its line, against answers as open drivers of it have them."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import pytest

from drivers.base import DeviceStoppedError
from drivers.characterization import molecular_devices_spectramax
from drivers.characterization.molecular_devices_spectramax import MolecularDevicesSpectramax
from drivers.load import call_action, load_driver, read_spec
from drivers.transports.base import ByteTransport
from drivers.transports.urls import make_transport
from labweb.common.instruments import csv_file
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conftest import Play
from tests.drivers.wire import answering
from tests.fixtures.running import until

CONFIG: dict[str, Any] = {
    "model": "m5",
    "rest_temperature_c": 20.0,
    "poll_s": 0.01,
    "settle_s": 0.0,
    "read_limit_s": 1.0,
    "move_limit_s": 1.0,
    "reach_limit_s": 1.0,
}
PREPARED = [
    "!CLEAR DATA",
    "!XPOS 14.380 9.000 12",
    "!YPOS 11.240 9.000 8",
    "!STRIP 1 12",
    "!SHAKE OFF",
    "!WAVELENGTH 450 600",
    "!CALIBRATE ONCE",
    "!MODE ENDPOINT",
    "!ORDER COLUMN",
    "!SPEED OFF",
    "!READTYPE ABSPLA",
]


def block(wavelength: int, base: float) -> str:
    columns = (
        f"{column}:\t" + "\t".join(f"{base + column / 100 + row / 1000:.3f}" for row in range(8))
        for column in range(1, 13)
    )
    return f"L:\t{wavelength}\r\n" + "\r\n".join(columns)


DATA = f"12.5\t25.1\t96-well\r\nL:\t450\t600\r\n{block(450, 0.1)}\r\n{block(600, -0.5)}\r\n"


class Reader:
    """Answers as the open drivers have it."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.drawer, self.state = "CLOSED", "IDLE"
        self.busy_asks = 2
        self.setpoint_c, self.reading_c = 20.0, 20.0
        self.data = DATA
        self.fails: dict[str, int] = {}
        self.mute = ""

    def __call__(self, request: bytes) -> bytes | None:
        command = request.decode().rstrip("\r")
        self.asked.append(command)
        word = command.split(" ")[0]
        if word == self.mute:
            return b""
        if word in self.fails:
            return f"FAIL\t {self.fails[word]}\r\n>".encode()
        fields = self.answer(command, word)
        return "".join(f"{field}\r\n>" for field in ["OK", *fields]).encode()

    def answer(self, command: str, word: str) -> list[str]:
        if word in {"!OPEN", "!CLOSE"}:
            self.drawer = "OPEN" if word == "!OPEN" else "CLOSED"
        if word == "!READ":
            self.state = "MEASURING"
        if word == "!STATUS":
            if self.state != "IDLE":
                self.busy_asks -= 1
                self.state = "IDLE" if self.busy_asks <= 0 else self.state
            return [f"{self.drawer}\r\n{self.state}\r\n"]
        if word == "!TEMP":
            if " " in command:
                self.setpoint_c = self.reading_c = float(command.split(" ")[1])
            return [f"{self.setpoint_c:.1f} {self.reading_c:.1f}"]
        if word == "!TRANSFER":
            return [self.data]
        return [""] if word in {"!SPEED", "!READTYPE"} else []


@pytest.fixture
def reader() -> Reader:
    return Reader()


@pytest.fixture
def device(reader: Reader) -> Iterator[MolecularDevicesSpectramax]:
    with ExitStack() as stack:
        port = stack.enter_context(answering(reader))
        transport = cast("ByteTransport", make_transport(f"tcp://127.0.0.1:{port}"))
        found = MolecularDevicesSpectramax(transport, CONFIG)
        found.connect()
        stack.callback(found.close)
        yield found


def test_a_plate_is_a_table_of_its_wells(
    reader: Reader, device: MolecularDevicesSpectramax, tmp_path: Path
) -> None:
    reader.data = DATA.replace("0.110", "#SAT")
    report = device.read_absorbance([450, 600])
    path = tmp_path / "absorbance.csv"
    path.write_bytes(report.files[0].data)
    columns = {column.name: column for column in csv_file.read(path).tables[0]}
    assert columns["well"].values[:9] == [*(f"{row}1" for row in "ABCDEFGH"), "A2"]
    assert columns["absorbance 450 nm"].values[:3] == [None, 0.111, 0.112]
    assert columns["absorbance 600 nm"].values[-1] == pytest.approx(-0.5 + 0.12 + 0.007)
    assert len(columns["place"].values) == 96
    assert report.evidence == {
        "wavelengths_nm": [450, 600],
        "temperature_c": 25.1,
        "saturated_count": 1,
    }
    at = reader.asked.index("!CLEAR DATA")
    assert reader.asked[at : at + 11] == PREPARED
    assert reader.asked.count("!READ") == 1
    assert reader.asked[-1] == "!TRANSFER"


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("L:\t450\t600", "L:\t450\t610"),
        ("\r\n12:\t", "\r\n13:\t"),
        ("0.110", "0.1l0"),
        ("0.110\t", ""),
        ("12.5\t25.1\t96-well", "12.5"),
        ("L:\t600\r\n", "L:\t601\r\n"),
    ],
)
def test_data_that_is_not_of_this_reading_is_refused(
    reader: Reader, device: MolecularDevicesSpectramax, wrong: str, right: str
) -> None:
    reader.data = DATA.replace(wrong, right, 1)
    assert reader.data != DATA
    with pytest.raises(FrameError) as caught:
        device.read_absorbance([450, 600])
    assert caught.value.effect is Effect.UNKNOWN


def test_a_reading_that_does_not_end_is_told(
    reader: Reader, device: MolecularDevicesSpectramax
) -> None:
    reader.busy_asks = 10_000
    with pytest.raises(DeviceError) as caught:
        device.read_absorbance([450, 600])
    assert (caught.value.code, caught.value.effect) == ("device.slow", Effect.PARTIAL)


@pytest.mark.parametrize(
    ("command", "effect"),
    [("!WAVELENGTH", Effect.NONE), ("!READ", Effect.NONE), ("!TRANSFER", Effect.PARTIAL)],
)
def test_a_refusal_is_told_with_its_reason(
    reader: Reader, device: MolecularDevicesSpectramax, command: str, effect: Effect
) -> None:
    reader.fails[command] = 111
    with pytest.raises(RejectedError, match="do not fit") as caught:
        device.read_absorbance([450, 600])
    assert caught.value.effect is effect


def test_a_lost_answer_to_the_start_is_in_doubt(
    reader: Reader, device: MolecularDevicesSpectramax, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(molecular_devices_spectramax, "ANSWER_S", 0.1)
    reader.mute = "!READ"
    with pytest.raises(DeviceTimeoutError) as caught:
        device.read_absorbance([450, 600])
    assert caught.value.effect is Effect.UNKNOWN
    assert reader.asked.count("!READ") == 1


def test_a_busy_reader_or_an_open_drawer_reads_nothing(
    reader: Reader, device: MolecularDevicesSpectramax
) -> None:
    reader.drawer = "OPEN"
    with pytest.raises(RejectedError, match="drawer is out"):
        device.read_absorbance([450])
    reader.drawer, reader.state, reader.busy_asks = "CLOSED", "AIR CAL206", 99
    with pytest.raises(RejectedError, match="AIR CAL206"):
        device.read_absorbance([450])
    assert "!READ" not in reader.asked


def test_the_drawer_is_watched(reader: Reader, device: MolecularDevicesSpectramax) -> None:
    assert device.open_drawer().evidence == {"is_drawer_open": True}
    assert device.is_drawer_open()
    assert device.close_drawer().evidence == {"is_drawer_open": False}
    assert [one for one in reader.asked if one != "!STATUS"] == ["!OPEN", "!CLOSE"]


def test_a_drawer_that_does_not_move_is_in_doubt(
    reader: Reader, device: MolecularDevicesSpectramax
) -> None:
    stuck = reader.answer

    def answer(command: str, word: str) -> list[str]:
        found = stuck(command, word)
        reader.drawer = "CLOSED"
        return found

    reader.answer = answer  # type: ignore[method-assign]
    with pytest.raises(DeviceError) as caught:
        device.open_drawer()
    assert (caught.value.code, caught.value.effect) == ("device.slow", Effect.UNKNOWN)


@pytest.mark.parametrize("code", [300, 301, 400, 402, 403])
@pytest.mark.parametrize("word", ["!OPEN", "!CLOSE", "!READ"])
def test_a_part_that_fails_is_no_refusal(
    reader: Reader, device: MolecularDevicesSpectramax, word: str, code: int
) -> None:
    reader.fails[word] = code
    acts = {"!OPEN": device.open_drawer, "!CLOSE": device.close_drawer}
    with pytest.raises(DeviceError, match=f"failed at {word}") as caught:
        acts[word]() if word in acts else device.read_absorbance([450, 600])
    assert not isinstance(caught.value, RejectedError)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.UNKNOWN)
    assert caught.value.context["code"] == code


def test_the_incubator_is_set_and_read_back(
    reader: Reader, device: MolecularDevicesSpectramax
) -> None:
    report = device.reach_temperature(37.0, 0.5)
    assert report.evidence == {"temperature_c": 37.0}
    assert "!TEMP 37.0" in reader.asked
    device.stop_control()
    assert reader.setpoint_c == 20.0
    with pytest.raises(PreconditionError):
        device.hold(1.0, 37.0, 0.5)


def test_a_stop_brings_the_incubator_to_rest(
    reader: Reader, device: MolecularDevicesSpectramax
) -> None:
    device.reach_temperature(37.0, 0.5)
    reader.busy_asks = 10_000
    errors: list[DeviceError] = []

    def read() -> None:
        try:
            device.read_absorbance([450, 600])
        except DeviceError as error:
            errors.append(error)

    reading = threading.Thread(target=read)
    reading.start()
    until(lambda: "!READ" in reader.asked, 3)
    device.stop()
    reading.join(5)
    (error,) = errors
    assert isinstance(error, DeviceStoppedError)
    assert error.effect is Effect.PARTIAL
    assert reader.setpoint_c == 20.0


def test_what_was_recorded_is_read_alike(play: Play) -> None:
    config = {"model": "plus_384", "rest_temperature_c": 0.0, "poll_s": 0.005}
    device = MolecularDevicesSpectramax(play("spectramax"), config)
    device.connect()
    assert device.temperature_c() == 22.0
    device.open_drawer()
    assert device.is_drawer_open()
    device.close_drawer()
    report = device.read_absorbance([450])
    assert report.evidence["saturated_count"] == 0
    assert len(report.files[0].data.splitlines()) == 2 + 96
    assert device.stop_control().evidence == {"temperature_c": 22.0}


@pytest.mark.parametrize(
    "wavelengths", [[], [189], [1001], [450, 450], list(range(400, 407)), [450.5], [True], ["450"]]
)
def test_wavelengths_that_it_has_not_are_refused_before_a_byte_is_sent(
    play: Play, wavelengths: list[Any]
) -> None:
    transport = play(text="")
    spec = read_spec("drivers.characterization.molecular_devices_spectramax")
    device = load_driver(spec.module, spec.class_name, spec.digest, transport, CONFIG)
    with pytest.raises(PreconditionError):
        call_action(device, "read_absorbance", {"wavelengths_nm": wavelengths})
    assert transport.sent == []


@pytest.mark.parametrize(
    "answer",
    ["OK\\r\\n>AJAR\\r\\nIDLE\\r\\n\\r\\n>", "ERR\\r\\n>x>", "OK\\r\\n>OPEN\\r\\n>", "\\xff>>"],
)
def test_another_who_answers_is_no_reader(play: Play, answer: str) -> None:
    with pytest.raises(FrameError) as caught:
        MolecularDevicesSpectramax(play(text=f"> !STATUS\\r\n< {answer}\n"), CONFIG).connect()
    assert caught.value.effect is Effect.NONE
