"""The RD6006 over Modbus, register by register."""

from collections.abc import Callable
from typing import cast

import pytest

from drivers.processing.riden_rd6006 import RidenRd6006
from drivers.transports.modbus import RegisterTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import DeviceError, Effect, PreconditionError, RejectedError
from tests.drivers.wire import answering


class Registers:
    """A supply that is nothing but its registers."""

    def __init__(self, **changed: int) -> None:
        self.values = {0: 60062, 8: 0, 9: 0, 10: 200, 11: 1055, 16: 0, 17: 0, 18: 0}
        self.values |= {int(name.removeprefix("r")): value for name, value in changed.items()}
        self.frozen = {int(name.removeprefix("r")) for name in changed}
        self.written: list[tuple[int, ...]] = []

    def __call__(self, request: bytes) -> bytes:
        function, address = request[7], int.from_bytes(request[8:10], "big")
        count = int.from_bytes(request[10:12], "big")
        if function == 3:
            values = [self.values.get(address + offset, 0) for offset in range(count)]
            body = bytes([1, 3, 2 * count]) + b"".join(value.to_bytes(2, "big") for value in values)
        else:
            data = request[13:]
            values = [int.from_bytes(data[2 * i : 2 * i + 2], "big") for i in range(count)]
            self.written.append((address, *values))
            for offset, value in enumerate(values):
                if address + offset not in self.frozen:
                    self.values[address + offset] = value
            body = bytes([1, 16]) + request[8:12]
        return request[:4] + len(body).to_bytes(2, "big") + body


def on(port: int) -> RidenRd6006:
    line = make_transport(f"modbus+tcp://127.0.0.1:{port}?device=1")
    settings = {"max_voltage_v": 12.0, "max_current_ma": 5000.0, "settle_s": 0.0}
    return RidenRd6006(cast("RegisterTransport", line), settings)


def supplying(answer: Callable[[bytes], bytes], volt: float = 2.0) -> dict[str, object]:
    with answering(answer) as port:
        supply = on(port)
        supply.connect()
        try:
            return supply.supply(volt, 3000.0).evidence
        finally:
            supply.close()


def test_setpoints_go_in_one_frame_and_then_the_output() -> None:
    registers = Registers()
    evidence = supplying(registers)
    assert evidence == {"voltage_v": 2.0, "current_ma": 1055.0, "is_on": True, "keeps": "voltage"}
    assert registers.written == [(8, 200, 3000), (18, 1)]


def test_the_model_with_finer_steps_is_refused() -> None:
    with pytest.raises(RejectedError, match="60065"):
        supplying(Registers(r0=60065))


def test_a_setpoint_that_is_not_taken_turns_the_output_off() -> None:
    registers = Registers(r8=100)
    with pytest.raises(RejectedError) as caught:
        supplying(registers)
    assert caught.value.effect is Effect.PARTIAL
    assert registers.written[-1] == (18, 0)


def test_a_trip_is_an_alarm() -> None:
    with pytest.raises(DeviceError, match="overcurrent") as caught:
        supplying(Registers(r16=2))
    assert caught.value.code == "device.alarm"


def test_a_voltage_between_two_steps_is_refused() -> None:
    registers = Registers()
    with pytest.raises(PreconditionError) as caught:
        supplying(registers, 2.005)
    assert caught.value.code == "device.resolution"
    assert registers.written == []
