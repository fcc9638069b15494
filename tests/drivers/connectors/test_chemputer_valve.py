"""The Chemputer valve against messages of its published command table."""

from __future__ import annotations

import pytest

from drivers.connectors.chemputer_valve import ChemputerValve
from labweb.domain.errors import DeviceError, Effect, PreconditionError, RejectedError
from tests.drivers.conftest import Play

DONE = "> pos 3\\x00\n< RESPOND: pos SUCCESS\\x00\n< RESPOND: pos DONE\\x00\n"


def test_a_transcript_of_a_turn(play: Play) -> None:
    device = ChemputerValve(play("chemputer_valve"), {})
    device.connect()
    assert device.port_index() is None
    assert device.select_port(3).evidence == {"port_index": 3}
    assert device.port_index() == 3


def test_a_refused_turn_leaves_the_valve_where_it_stood(play: Play) -> None:
    device = ChemputerValve(play(text=DONE + "> pos 4\\x00\n< RESPOND: pos FAILURE\\x00\n"), {})
    device.select_port(3)
    with pytest.raises(RejectedError):
        device.select_port(4)
    assert device.port_index() == 3


def test_a_turn_that_fails_on_its_way_leaves_it_nowhere_known(play: Play) -> None:
    text = DONE + "> pos 4\\x00\n< RESPOND: pos SUCCESS\\x00\n< RESPOND: pos Stall\\x00\n"
    device = ChemputerValve(play(text=text), {})
    device.select_port(3)
    with pytest.raises(DeviceError) as caught:
        device.select_port(4)
    assert caught.value.effect is Effect.UNKNOWN
    assert device.port_index() is None


def test_a_lab_that_counts_from_1_turns_to_the_same_place_by_another_number(play: Play) -> None:
    device = ChemputerValve(play(text=DONE), {"first_port_index": 1})
    assert device.select_port(4).evidence == {"port_index": 4}
    assert device.port_index() == 4
    for port in (0, 7):
        with pytest.raises(PreconditionError):
            device.select_port(port)


def test_an_error_of_the_valve_is_told(play: Play) -> None:
    text = "> read_errors\\x00\n< ERRORS: {}\\x00\n"
    device = ChemputerValve(play(text=text.format(0) + text.format(32)), {})
    assert [device.has_error(), device.has_error()] == [False, True]


@pytest.mark.parametrize("port", [-1, 6])
def test_ports_are_numbered_as_on_the_valve(play: Play, port: int) -> None:
    with pytest.raises(PreconditionError):
        ChemputerValve(play(text=""), {}).select_port(port)
