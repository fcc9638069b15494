"""SCPI supplies against bytes of its published command table."""

import pytest

from drivers.processing.scpi_supply import ScpiSupply, decode_number
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError
from tests.drivers.conftest import Play

CHECK = "> MEAS:VOLT?\\n\n< +0.00000000E+00\\r\\n\n> *CLS\\n\n"
SET = "> VOLT 1.8200\\n\n> CURR 1.50000\\n\n"
FINE = '> SYST:ERR?\\n\n< +0,"No error"\\r\\n\n'
TAKEN = "> VOLT?\\n\n< +1.82000000E+00\\r\\n\n> CURR?\\n\n< +1.50000000E+00\\r\\n\n"
OFF = "> OUTP OFF\\n\n> OUTP?\\n\n< 0\\r\\n\n"


def report(volt: str, ampere: str, output: int) -> str:
    measured = f"> MEAS:VOLT?\\n\n< {volt}\\r\\n\n> MEAS:CURR?\\n\n< {ampere}\\r\\n\n"
    return f"{measured}> OUTP?\\n\n< {output}\\r\\n\n"


def supply(transport: object, model: str = "keysight_e3633a") -> ScpiSupply:
    settings = {"model": model, "max_voltage_v": 8.0, "max_current_ma": 5000.0, "settle_s": 0.0}
    return ScpiSupply(transport, settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("model", "query", "condition", "kept"),
    [
        ("keysight_e3633a", "STAT:QUES:COND?", 2, "voltage"),
        ("keysight_e3633a", "STAT:QUES:COND?", 1, "current"),
        ("itech_it6300", "STAT:OPER:COND?", 16, "voltage"),
        ("itech_it6300", "STAT:OPER:COND?", 32, "current"),
    ],
)
def test_the_models_tell_in_their_own_register_what_they_keep(
    play: Play, model: str, query: str, condition: int, kept: str
) -> None:
    text = (
        CHECK
        + SET
        + FINE
        + TAKEN
        + "> OUTP ON\\n\n"
        + FINE
        + report("1.82", "0.69", 1)
        + f"> {query}\\n\n< {condition}\\r\\n\n"
    )
    evidence = supply(play(text=text), model).supply(1.82, 1500.0).evidence
    assert evidence == {"voltage_v": 1.82, "current_ma": 690.0, "is_on": True, "keeps": kept}


def test_an_error_in_the_queue_turns_the_output_off(play: Play) -> None:
    text = (
        CHECK
        + SET
        + '> SYST:ERR?\\n\n< -222,"Data out of range"\\r\\n\n'
        + OFF
        + report("0", "0", 0)
    )
    with pytest.raises(RejectedError, match="-222") as caught:
        supply(play(text=text)).supply(1.82, 1500.0)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["is_on"] is False


def test_a_hardware_fault_is_an_alarm(play: Play) -> None:
    text = (
        CHECK
        + SET
        + FINE
        + TAKEN
        + "> OUTP ON\\n\n"
        + FINE
        + report("0", "0", 1)
        + "> STAT:QUES:COND?\\n\n< 3\\r\\n\n"
        + OFF
        + report("0", "0", 0)
    )
    with pytest.raises(DeviceError) as caught:
        supply(play(text=text)).supply(1.82, 1500.0)
    assert caught.value.code == "device.alarm"


def test_the_other_model_is_refused(play: Play) -> None:
    text = "> *IDN?\\n\n< ITECH Ltd, IT6333, 1, 1.04\\n\n"
    with pytest.raises(RejectedError, match="IT6333"):
        supply(play(text=text)).connect()


@pytest.mark.parametrize("frame", [b"nan\n", b"1.8.2\n", b"\n", b"\xb1.82\n", b"1e999\n"])
def test_a_garbled_number_is_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_number(frame)
