"""URLs name a line and its settings, and nothing is guessed."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.transports.serial import SerialTransport
from drivers.transports.urls import FORMS, line_key, make_transport
from labweb.domain.errors import DefinitionError


@pytest.mark.parametrize("url", FORMS)
def test_every_form_in_the_documentation_is_accepted(url: str) -> None:
    transport = make_transport(url)
    assert not transport.is_open
    assert transport.line == line_key(url)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "ttyUSB0",
        "https://127.0.0.1:443",
        "http://127.0.0.1",
        "http://127.0.0.1:80/snapshot.jpg",
        "http://user:guest@127.0.0.1:80",
        "tcp://127.0.0.1",
        "tcp://127.0.0.1:0",
        "tcp://127.0.0.1:70000",
        "tcp://127.0.0.1:4305?baud=9600",
        "tcp://user@127.0.0.1:4305",
        "tcp://[::1:4305",
        "tcp://127.0.0.1:4305?also=",
        "tcp://127.0.0.1:4305?also=4305",
        "tcp://127.0.0.1:4305?also=4306,4306",
        "serial://ttyUSB0",
        "serial:///dev/ttyUSB0?baud=fast",
        "serial:///dev/ttyUSB0?format=9N1",
        "serial:///dev/ttyUSB0?format=8N1&format=7E1",
        "serial:///dev/ttyUSB0?speed=9600",
        "serial:///dev/ttyUSB0?flow=maybe",
        "modbus+tcp://127.0.0.1:502?device=0",
        "modbus+tcp://127.0.0.1:502?device=248",
        "s7://127.0.0.1:102",
        "s7://127.0.0.1:102/0",
        "s7://127.0.0.1:102/8/1",
        "s7://127.0.0.1:102/0/32",
        "s7://127.0.0.1/0/1",
        "sila+local://192.168.1.60:50052",
        "sila://192.168.1.60:50052?ca=server.pem",
        "sila://192.168.1.60",
        "http://192.168.1.21:6820?token=cluster.token",
        "http://192.168.1.21:6820?token=/etc/shadow",
        "visa:GPIB0::8::INSTR",
        "visa://GPIB0::31::INSTR",
        "visa://GPIB0::8",
        "visa://USB0::0x1111::0x2222::*::INSTR",
        "visa://USB0::0x1111::0x2222::1234::0::INSTR",
        "visa://USB0::0x1111::0x2222::1234::RAW",
        "visa://ASRL1::INSTR",
        "visa://TCPIP0::host::INSTR",
        "visa://TCPIP0::host::5025::SOCKET",
        "virtual:",
        "virtual:../../etc",
    ],
)
def test_anything_else_is_refused_with_an_example(url: str) -> None:
    with pytest.raises(DefinitionError, match=r"tcp://127\.0\.0\.1:4305") as caught:
        make_transport(url)
    assert caught.value.code == "transport.url"


def test_serial_settings_come_from_the_url() -> None:
    transport = make_transport("serial:///dev/ttyUSB0?baud=4800&format=7E2&flow=rtscts")
    assert isinstance(transport, SerialTransport)
    settings = transport.settings
    assert (settings.baud, settings.data_bits, settings.parity) == (4800, 7, "E")
    assert (settings.stop_bits, settings.flow) == (2, "rtscts")
    slow = make_transport("serial:///dev/ttyUSB0?baud=230400&flow=xonxoff")
    assert isinstance(slow, SerialTransport)
    assert slow.settings.flow == "xonxoff"


def test_a_line_keeps_its_name_when_its_link_points_elsewhere(tmp_path: Path) -> None:
    link = tmp_path / "pump"
    before = line_key(f"serial://{link}")
    link.symlink_to(tmp_path / "ttyS0")
    assert line_key(f"serial://{link}") == before == f"serial:{link}"


def test_devices_of_one_modbus_line_share_it() -> None:
    first = "modbus+tcp://127.0.0.1:502?device=1"
    second = "modbus+tcp://127.0.0.1:502?device=2"
    line = make_transport(first)
    companion = line.for_url(second)
    assert line_key(first) == line_key(second) == companion.line
    assert line.for_url(first) is line
    assert companion.lock is line.lock


def test_one_line_has_one_setting() -> None:
    line = make_transport("serial:///dev/ttyUSB0?baud=9600")
    assert line.for_url("serial:///dev/ttyUSB0?baud=9600") is line
    with pytest.raises(DefinitionError):
        line.for_url("serial:///dev/ttyUSB0?baud=38400")
