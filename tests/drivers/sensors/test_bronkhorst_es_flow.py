"""The ES-FLOW meter by the registers of its manual, on a serial line and against its model."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, cast

import pytest

from drivers.load import read_statuses
from drivers.sensors.bronkhorst_es_flow import (
    UL_S,
    BronkhorstEsFlow,
    decode_float,
    decode_text,
)
from drivers.transports.modbus import RegisterTransport, Table
from drivers.transports.urls import make_transport
from labweb.domain.errors import Effect, FrameError, RejectedError
from tests.drivers.rtu import line_of

UNIT, CAPACITY, FLOW, SERIAL = 0x81F8, 0x8168, 0xA100, 0xF118


class Registers(RegisterTransport):
    """A line with a table behind it; what is told twice may differ."""

    def __init__(self, *tables: Mapping[int, bytes]) -> None:
        super().__init__("test:line", "test:line")
        self.tables = list(tables)

    def read_registers(
        self, address: int, count: int, *, table: Table = "holding"
    ) -> tuple[int, ...]:
        assert table == "holding"
        data = self.tables[0][address]
        if address == FLOW and len(self.tables) > 1:
            self.tables.pop(0)
        assert len(data) == 2 * count
        return struct.unpack(f">{count}H", data)

    def write_registers(self, address: int, values: Any) -> None:  # noqa: ANN401 - never called
        raise AssertionError((address, values))

    def write_register(self, address: int, value: int) -> None:
        raise AssertionError((address, value))

    def _open(self) -> None:
        return

    def _close(self) -> None:
        return

    @property
    def is_open(self) -> bool:
        return True


def told(flow: float, unit: str = "ml/min", capacity: float = 100.0) -> dict[int, bytes]:
    return {
        UNIT: unit.encode().ljust(8, b"\0"),
        CAPACITY: struct.pack(">f", capacity),
        FLOW: struct.pack(">f", flow),
        SERIAL: b"M1".ljust(16, b"\0"),
    }


def a_meter(*tables: Mapping[int, bytes], **config: object) -> BronkhorstEsFlow:
    return BronkhorstEsFlow(Registers(*tables), config)


def test_it_asks_for_whole_parameters_on_a_serial_line() -> None:
    with line_of("bronkhorst_es_flow") as path:
        url = f"modbus+serial://{path}?baud=19200&format=8N1&device=1"
        line = cast("RegisterTransport", make_transport(url))
        meter = BronkhorstEsFlow(line, {"serial_number": "M21200001A"})
        meter.connect()
        assert meter.measure().evidence == {"flow_ul_s": pytest.approx(100.0)}
        meter.close()


@pytest.mark.parametrize(
    ("unit", "ul_s"),
    [
        ("l/min", 16666.667),
        ("ml/h", 0.27777778),
        ("ml/min", 16.666667),
        ("l/h", 277.77778),
        ("mm3/s", 1.0),
        ("cm3/min", 16.666667),
    ],
)
def test_each_unit_of_its_list_becomes_microlitres_a_second(unit: str, ul_s: float) -> None:
    assert list(UL_S) == ["l/min", "ml/h", "ml/min", "l/h", "mm3/s", "cm3/min"]
    meter = a_meter(told(1.0, unit))
    assert read_statuses(meter) == {"flow_ul_s": pytest.approx(ul_s)}


def test_what_flows_back_is_negative() -> None:
    assert a_meter(told(-3.0)).flow_ul_s() == pytest.approx(-50.0)


@pytest.mark.parametrize("unit", ["g/h", "mln/min", "", "ml", "ML/MIN"])
def test_a_unit_of_mass_or_gas_or_none_is_refused(unit: str) -> None:
    meter = a_meter(told(1.0, unit))
    for ask in (meter.identify, meter.measure):
        with pytest.raises(RejectedError, match="no volume of liquid") as refusal:
            ask()
        assert refusal.value.effect is Effect.NONE


def test_another_meter_at_its_address_is_refused() -> None:
    a_meter(told(1.0), serial_number="M1").identify()
    with pytest.raises(RejectedError, match="expected 'M2'"):
        a_meter(told(1.0), serial_number="M2").identify()


def test_a_unit_that_changes_while_it_is_read_makes_no_value() -> None:
    meter = a_meter(told(1.0, "ml/min"), told(1.0, "l/h"))
    with pytest.raises(RejectedError, match="set from ml/min to l/h"):
        meter.measure()
    assert meter.measure().evidence["flow_ul_s"] == pytest.approx(277.77778)


def test_the_end_of_its_range_is_no_reading() -> None:
    assert a_meter(told(131.0)).flow_ul_s() == pytest.approx(2183.3333)
    with pytest.raises(RejectedError, match="more may flow"):
        a_meter(told(131.07)).flow_ul_s()


@pytest.mark.parametrize("capacity", [0.0, -1.0])
def test_a_capacity_that_is_none_is_no_reading(capacity: float) -> None:
    with pytest.raises(FrameError):
        a_meter(told(1.0, capacity=capacity)).flow_ul_s()


def test_what_is_no_number_or_no_text_is_no_reading() -> None:
    with pytest.raises(FrameError):
        decode_float((0x7FC0, 0))
    with pytest.raises(FrameError):
        decode_text((0xFFFF,))
