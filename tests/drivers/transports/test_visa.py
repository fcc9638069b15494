"""VISA against pyvisa-sim: its own instruments, and an E3633A whose answers are written down."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from pyvisa.constants import StatusCode
from pyvisa.errors import VisaIOError
from pyvisa_sim.highlevel import SimVisaLibrary  # type: ignore[import-untyped]

from drivers.processing import scpi_supply
from drivers.processing.scpi_supply import ScpiSupply
from drivers.transports.urls import addresses_of, line_key, make_transport
from drivers.transports.visa.transport import VisaTransport
from labweb.domain.errors import (
    DefinitionError,
    DeviceTimeoutError,
    Effect,
    RejectedError,
    UnreachableError,
)

OWN = "@sim"
E3633A = f"{Path(__file__).with_name('e3633a.yaml')}@sim"
CONFIG = {
    "model": "keysight_e3633a",
    "max_voltage_v": 30.0,
    "max_current_ma": 5000.0,
    "settle_s": 0.0,
}


def at(resource: str, library: str = OWN) -> VisaTransport:
    return VisaTransport(f"visa://{resource}", resource, library)


@pytest.fixture
def line() -> Iterator[VisaTransport]:
    line = at("GPIB0::8::INSTR")
    line.open()
    yield line
    line.close()


@pytest.fixture
def supply(monkeypatch: pytest.MonkeyPatch) -> Iterator[ScpiSupply]:
    monkeypatch.setattr(scpi_supply, "ANSWER_S", 0.2)
    supply = ScpiSupply(at("GPIB0::5::INSTR", E3633A), CONFIG)
    supply.connect()
    yield supply
    supply.close()


def broken(code: StatusCode) -> object:
    def fail(*_: object) -> None:
        raise VisaIOError(code)

    return fail


def test_what_is_asked_is_answered_and_seen(line: VisaTransport) -> None:
    seen: list[tuple[str, bytes]] = []
    line.observer = lambda way, data: seen.append((way, data))
    assert line.exchange(b"?IDN\n", until=b"\n", timeout_s=1.0) == b"LSG Serial #1234\n"
    assert seen == [("out", b"?IDN\n"), ("in", b"LSG Serial #1234\n")]


def test_an_instrument_on_usb_is_asked_and_answers() -> None:
    line = at("USB0::0x1111::0x2222::0x1234::INSTR")
    assert line.line == "usb:1111:2222:0x1234"
    line.open()
    try:
        assert line.exchange(b"?IDN\n", until=b"\n", timeout_s=1.0) == b"LSG Serial #1234\n"
        assert line.exchange(b"!FREQ 50.25\n", until=b"\n", timeout_s=1.0) == b"OK\n"
        assert line.exchange(b"?FREQ\n", until=b"\n", timeout_s=1.0) == b"50.25\n"
    finally:
        line.close()
    with pytest.raises(UnreachableError, match="usb:1111:2222:0x9999"):
        at("USB0::0x1111::0x2222::0x9999::INSTR").open()


def test_a_setter_of_the_public_instrument_is_kept(line: VisaTransport) -> None:
    assert line.exchange(b"!FREQ 50.25\n", until=b"\n", timeout_s=1.0) == b"OK\n"
    assert line.exchange(b"?FREQ\n", until=b"\n", timeout_s=1.0) == b"50.25\n"
    assert line.exchange(b"!FREQ 0.10\n", until=b"\n", timeout_s=1.0) == b"FREQ_ERROR\n"


def test_silence_is_a_timeout_and_unknown_and_the_next_question_is_answered(
    line: VisaTransport,
) -> None:
    with pytest.raises(DeviceTimeoutError) as caught:
        line.exchange(b"*RST\n", until=b"\n", timeout_s=0.1)
    assert caught.value.effect is Effect.UNKNOWN
    assert line.exchange(b"?IDN\n", until=b"\n", timeout_s=1.0) == b"LSG Serial #1234\n"


def test_where_nothing_can_be_cleared_the_rest_is_read_away(
    line: VisaTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse = broken(StatusCode.error_nonsupported_operation)
    monkeypatch.setattr(SimVisaLibrary, "clear", refuse, raising=False)
    with pytest.raises(DeviceTimeoutError):
        line.exchange(b"?IDN\n", until=b"never", timeout_s=0.1)
    assert line.exchange(b"?AMP\n", until=b"\n", timeout_s=1.0) == b"1.00\n"


def test_what_came_late_is_never_the_answer_to_the_next_question(line: VisaTransport) -> None:
    with pytest.raises(DeviceTimeoutError):
        line.exchange(b"?IDN\n", until=b"never", timeout_s=0.1)
    line.send(b"?AMP\n")
    assert line.receive(until=b"\n", timeout_s=1.0) == b"1.00\n"


def test_an_instrument_is_not_read_from_before_it_was_asked(
    line: VisaTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[int] = []
    real = SimVisaLibrary.read

    def counted(self: SimVisaLibrary, session: object, count: int) -> object:
        reads.append(count)
        return real(self, session, count)

    monkeypatch.setattr(SimVisaLibrary, "read", counted)
    line.send(b"*RST\n")
    line.send(b"*RST\n")
    assert reads == []
    line.exchange(b"?IDN\n", until=b"\n", timeout_s=1.0)
    assert len(reads) == 1


def test_a_bus_that_breaks_is_unknown_once_something_was_sent(
    line: VisaTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SimVisaLibrary, "read", broken(StatusCode.error_connection_lost))
    with pytest.raises(UnreachableError, match="VI_ERROR_CONN_LOST") as caught:
        line.exchange(b"?IDN\n", until=b"\n", timeout_s=1.0)
    assert caught.value.effect is Effect.UNKNOWN
    assert not line.is_open
    with pytest.raises(UnreachableError) as caught:
        line.exchange(b"?IDN\n", until=b"\n", timeout_s=1.0)
    assert caught.value.effect is Effect.NONE


def test_nobody_at_the_address_is_unreachable() -> None:
    line = at("GPIB0::29::INSTR")
    with pytest.raises(UnreachableError, match="gpib:0") as caught:
        line.open()
    assert caught.value.effect is Effect.NONE
    assert not line.is_open


def test_instruments_on_one_bus_take_turns(line: VisaTransport) -> None:
    other = line.for_url("visa://GPIB0::9::INSTR")
    assert isinstance(other, VisaTransport)
    assert other.lock is line.lock
    assert other.line == line.line == line_key("visa://GPIB0::9::INSTR") == "gpib:0"
    other.open()
    assert other.exchange(b"*IDN?\n", until=b"\n", timeout_s=1.0) == b"SCPI,MOCK,VERSION_1.0\n"
    other.close()
    assert line.is_open
    assert line.for_url(line.url) is line
    with pytest.raises(DefinitionError):
        line.for_url("visa://GPIB1::9::INSTR")


def test_a_line_over_hislip_reaches_its_port_and_a_bus_none() -> None:
    assert addresses_of("visa://TCPIP0::10.0.0.7::hislip0::INSTR") == (("10.0.0.7", 4880),)
    assert addresses_of("visa://GPIB0::8::INSTR") == ()
    assert line_key("visa://TCPIP0::10.0.0.7::hislip0::INSTR") == "tcp:10.0.0.7:4880"
    assert isinstance(make_transport("visa://GPIB0::8::INSTR"), VisaTransport)


def test_a_supply_on_a_bus_is_driven_by_the_driver_of_the_serial_one(supply: ScpiSupply) -> None:
    evidence = supply.supply(1.82, 1500.0).evidence
    assert evidence == {"voltage_v": 1.82, "current_ma": 690.0, "is_on": True, "keeps": "voltage"}
    assert supply.voltage_setpoint_v() == 1.82
    assert supply.current_setpoint_ma() == 1500.0


def test_what_the_supply_refuses_is_told_and_not_taken_for_success(supply: ScpiSupply) -> None:
    with pytest.raises(RejectedError, match="-222") as caught:
        supply.supply(25.0, 1500.0)
    assert caught.value.effect is Effect.UNKNOWN  # this one says that its output is on for ever
    assert caught.value.context["not_turned_off"] == "the output is still on"


def test_a_supply_that_rests_tells_that_no_current_flows() -> None:
    supply = ScpiSupply(at("GPIB0::6::INSTR", E3633A), CONFIG)
    supply.connect()
    try:
        evidence = supply.stop_supply().evidence
    finally:
        supply.close()
    assert evidence == {"voltage_v": 0.0, "current_ma": 0.0, "is_on": False}


def test_another_instrument_at_the_address_is_not_connected() -> None:
    supply = ScpiSupply(at("GPIB0::9::INSTR"), CONFIG)
    with pytest.raises(RejectedError, match="SCPI,MOCK") as caught:
        supply.connect()
    assert caught.value.effect is Effect.NONE
    assert not supply.transport.is_open


def test_a_bus_that_breaks_in_mid_action_is_unknown(
    supply: ScpiSupply, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supply, "_refuse_error", lambda: supply.transport.exchange(
        b"*TST?\n", until=b"\n", timeout_s=0.1))  # fmt: skip
    with pytest.raises(DeviceTimeoutError) as caught:
        supply.supply(1.82, 1500.0)
    assert caught.value.effect is Effect.UNKNOWN
