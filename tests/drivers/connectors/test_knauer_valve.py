"""The Azura multiposition valve against bytes of its published command table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connectors._knauer_valve import FAULTS, decode_line
from drivers.connectors.knauer_valve import KnauerValve
from labweb.domain.errors import DefinitionError, DeviceError, Effect, FrameError, RejectedError
from tests.drivers.conftest import Play

CONFIG = {"ports_count": 12}


def test_a_transcript_of_a_turn(play: Play) -> None:
    device = KnauerValve(play("knauer_valve"), CONFIG)
    device.connect()
    assert device.select_port(3).evidence == {"port_index": 3}


@pytest.mark.parametrize("told", ["6", "LI"])
def test_another_valve_than_was_set_is_refused(play: Play, told: str) -> None:
    with pytest.raises(RejectedError, match="VALVE 12"):
        KnauerValve(play(text=f"> T\\r\\n\n< VALVE {told}\\r\\n\n"), CONFIG).connect()


@pytest.mark.parametrize("answer", ["?", "E0"])
def test_a_turn_that_is_not_taken_has_no_effect(play: Play, answer: str) -> None:
    with pytest.raises(RejectedError) as caught:
        KnauerValve(play(text=f"> 3\\r\\n\n< {answer}\\r\\n\n"), CONFIG).select_port(3)
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize("fault", sorted(FAULTS))
def test_a_fault_is_in_doubt_and_named(play: Play, fault: str) -> None:
    text = f"> 3\\r\\n\n< 3\\r\\n\n> P\\r\\n\n< {fault}\\r\\n\n"
    with pytest.raises(DeviceError, match=FAULTS[fault]) as caught:
        KnauerValve(play(text=text), CONFIG).select_port(3)
    assert caught.value.effect is Effect.UNKNOWN


def test_another_echo_is_in_doubt(play: Play) -> None:
    with pytest.raises(FrameError) as caught:
        KnauerValve(play(text="> 3\\r\\n\n< 8\\r\\n\n"), CONFIG).select_port(3)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_valve_with_other_ports_does_not_exist(play: Play) -> None:
    with pytest.raises(DefinitionError):
        KnauerValve(play(text=""), {"ports_count": 8})


@given(st.binary(max_size=32))
def test_any_bytes_are_a_line_or_an_error_of_ours(frame: bytes) -> None:
    try:
        decode_line(frame)
    except (FrameError, DeviceError):
        return
