"""The S-EC/TDS-01 over Modbus TCP, byte for byte."""

from typing import cast

import pytest

from drivers.load import read_statuses
from drivers.sensors.seeed_tds import SeeedTds, decode_registers
from drivers.transports.modbus import RegisterTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import FrameError
from tests.drivers.wire import answering


def test_all_values_are_read_in_one_request() -> None:
    requests: list[bytes] = []

    def answer(request: bytes) -> bytes:
        requests.append(request)
        body = bytes.fromhex("01 03 0A 09D0 0001 0001 02BC 02EE")
        return request[:4] + len(body).to_bytes(2, "big") + body

    with answering(answer) as port:
        line = make_transport(f"modbus+tcp://127.0.0.1:{port}?device=1")
        sensor = SeeedTds(cast("RegisterTransport", line), {})
        sensor.connect()
        assert sensor.measure().evidence == {
            "temperature_c": 25.12,
            "conductivity_us_cm": 65537.0,
            "salinity_ppm": 700.0,
            "tds_ppm": 750.0,
        }
        assert set(read_statuses(sensor)) == {"conductivity_us_cm", "tds_ppm", "temperature_c"}
        sensor.close()
    assert requests[0][6:].hex() == "010300000005"


def test_a_temperature_below_zero_is_signed() -> None:
    assert decode_registers((0xFFF6, 0, 0, 0, 0)).temperature_c == -0.1


@pytest.mark.parametrize("registers", [(0x7FFF, 0, 0, 0, 0), (2500, 0, 0, 0, 20_001)])
def test_values_that_no_liquid_has_are_refused(registers: tuple[int, ...]) -> None:
    with pytest.raises(FrameError):
        decode_registers(registers)
