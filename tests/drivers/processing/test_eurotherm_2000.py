"""The 2000 series over Modbus, register by register."""

from typing import cast

import pytest

from drivers.processing.eurotherm_2000 import Eurotherm2000
from drivers.transports.modbus import RegisterTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import DeviceError, Effect, PreconditionError, RejectedError
from tests.drivers.wire import answering

CONFIG = {
    "decimals_count": 1,
    "rest_temperature_c": 20.0,
    "max_temperature_c": 200.0,
    "poll_s": 0.005,
    "settle_s": 0.0,
}


class Registers:
    """A controller that is nothing but its registers."""

    def __init__(self, **changed: int) -> None:
        self.values = {1: 600, 2: 200, 111: 1500, 112: 0}
        self.values |= {int(name.removeprefix("r")): value for name, value in changed.items()}
        self.written: list[tuple[int, int, int]] = []

    def __call__(self, request: bytes) -> bytes:
        function, address = request[7], int.from_bytes(request[8:10], "big")
        value = int.from_bytes(request[10:12], "big")
        if function == 3:
            body = bytes([1, 3, 2]) + self.values[address].to_bytes(2, "big")
        else:
            self.written.append((function, address, value))
            self.values[address] = min(value, 1000) if value < 0x8000 else value
            body = request[6:12]
        return request[:4] + len(body).to_bytes(2, "big") + body


def reaching(registers: Registers, temperature_c: float) -> dict[str, object]:
    with answering(registers) as port:
        line = make_transport(f"modbus+tcp://127.0.0.1:{port}?device=1")
        controller = Eurotherm2000(cast("RegisterTransport", line), CONFIG)
        controller.connect()
        try:
            return controller.reach_temperature(temperature_c, 1.0).evidence
        finally:
            controller.close()


def test_a_setpoint_is_a_whole_number_of_decimals_and_goes_by_function_6() -> None:
    registers = Registers()
    assert reaching(registers, 60.0) == {"temperature_c": 60.0, "temperature_setpoint_c": 60.0}
    assert registers.written == [(6, 2, 600)]


def test_a_temperature_below_zero_is_signed() -> None:
    registers = Registers(r1=0x10000 - 100, r112=0x10000 - 500)
    assert reaching(registers, -10.0)["temperature_setpoint_c"] == -10.0


def test_the_limits_of_the_controller_are_kept() -> None:
    registers = Registers()
    with pytest.raises(PreconditionError, match="150"):
        reaching(registers, 160.0)
    assert registers.written == []


def test_a_setpoint_that_is_not_taken_brings_it_to_rest() -> None:
    registers = Registers()
    with pytest.raises(RejectedError) as caught:
        reaching(registers, 120.0)
    assert caught.value.effect is Effect.PARTIAL
    assert registers.written[-1] == (6, 2, 200)


def test_limits_in_the_wrong_order_are_no_controller() -> None:
    with pytest.raises(DeviceError, match="no controller"):
        reaching(Registers(r111=0), 60.0)
