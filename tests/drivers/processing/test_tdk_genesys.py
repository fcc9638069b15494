"""The Genesys series against bytes of its published command table."""

import pytest

from drivers.processing.tdk_genesys import TdkGenesys
from labweb.domain.errors import Effect, FrameError, RejectedError
from tests.drivers.conftest import Play


def ask(command: str, answer: str) -> str:
    return f"> ADR 6\\r\n< OK\\r\n> {command}\\r\n< {answer}\\r\n"


REPORT = ask("MV?", "1.820") + ask("MC?", "0.690")


def supply(transport: object) -> TdkGenesys:
    return TdkGenesys(transport, {"max_voltage_v": 8.0, "max_current_ma": 5000.0, "settle_s": 0.0})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "answers", [("OK", "OK"), ("VOLTAGE SET TO: 1.820", "CURRENT SET TO: 1.500")]
)
def test_supplies_and_their_emulators_are_understood(play: Play, answers: tuple[str, str]) -> None:
    text = (
        ask("MV?", "0.000")
        + ask("RMT 1", "OK")
        + ask("PV 1.820", answers[0])
        + ask("PC 1.500", answers[1])
        + ask("PV?", "1.820")
        + ask("PC?", "1.500")
        + ask("OUT ON", "OK")
        + ask("OUT?", "ON")
        + REPORT
        + ask("OUT?", "ON")
    )
    evidence = supply(play(text=text)).supply(1.82, 1500.0).evidence
    assert evidence == {"voltage_v": 1.82, "current_ma": 690.0, "is_on": True}


def test_a_refused_setpoint_turns_the_output_off(play: Play) -> None:
    text = (
        ask("MV?", "0.000")
        + ask("RMT 1", "OK")
        + ask("PV 1.820", "E01")
        + ask("OUT OFF", "OK")
        + ask("OUT?", "OFF")
        + REPORT
        + ask("OUT?", "OFF")
    )
    with pytest.raises(RejectedError, match="E01") as caught:
        supply(play(text=text)).supply(1.82, 1500.0)
    assert caught.value.effect is Effect.PARTIAL


def test_every_command_goes_to_its_address(play: Play) -> None:
    transport = play(text=ask("IDN?", "LAMBDA,GEN40-38"))
    supply(transport).connect()
    assert transport.sent == [b"ADR 6\r", b"IDN?\r"]


def test_a_garbled_answer_is_a_frame_error(play: Play) -> None:
    with pytest.raises(FrameError):
        supply(play(text=ask("MV?", "1.8x"))).voltage_v()
