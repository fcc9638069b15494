"""The PL-P series against bytes of its published command table."""

import pytest

from drivers.processing.tti_pl import TtiPl, decode_number
from labweb.domain.errors import DeviceError, Effect, FrameError, PreconditionError
from tests.drivers.conftest import Play

SET = (
    "> LSR1?\\n\n< 0\\r\\n\n> V1 1.820\\n\n> I1 1.5000\\n\n"
    "> V1?\\n\n< V1 1.820\\r\\n\n> I1?\\n\n< I1 1.5000\\r\\n\n> OP1 1\\n\n"
)


def report(volt: str, ampere: str, output: int) -> str:
    return (
        f"> V1O?\\n\n< {volt}V\\r\\n\n> I1O?\\n\n< {ampere}A\\r\\n\n> OP1?\\n\n< {output}\\r\\n\n"
    )


def supply(transport: object) -> TtiPl:
    return TtiPl(transport, {"max_voltage_v": 8.0, "max_current_ma": 5000.0, "settle_s": 0.0})  # type: ignore[arg-type]


@pytest.mark.parametrize(("events", "kept"), [(1, "voltage"), (2, "current")])
def test_it_tells_what_it_keeps(play: Play, events: int, kept: str) -> None:
    text = (
        SET
        + report("1.8200", "0.6900", 1)
        + f"> LSR1?\\n\n< {events}\\r\\n\n> OP1?\\n\n< 1\\r\\n\n"
    )
    evidence = supply(play(text=text)).supply(1.82, 1500.0).evidence
    assert evidence == {"voltage_v": 1.82, "current_ma": 690.0, "is_on": True, "keeps": kept}


def test_a_trip_is_an_alarm_and_the_output_is_off(play: Play) -> None:
    text = (
        SET + report("0.0000", "0.0000", 0) + "> LSR1?\\n\n< 4\\r\\n\n"
        "> OP1 0\\n\n> OP1?\\n\n< 0\\r\\n\n" + report("0.0000", "0.0000", 0)
    )
    with pytest.raises(DeviceError, match="voltage trip") as caught:
        supply(play(text=text)).supply(1.82, 1500.0)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.PARTIAL)


def test_a_value_between_two_steps_is_refused(play: Play) -> None:
    with pytest.raises(PreconditionError) as caught:
        supply(play(text="")).supply(1.8205, 1500.0)
    assert caught.value.code == "device.resolution"


@pytest.mark.parametrize("frame", [b"1.8200\r\n", b"V1 1.82V\r\n", b"1.82\xd6\r\n"])
def test_a_garbled_measurement_is_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_number(frame, "", "V")
