"""The two-position actuator against bytes of its published command table."""

from __future__ import annotations

import pytest

from drivers.connectors.vici_injection import ViciInjection
from labweb.domain.errors import DefinitionError, RejectedError
from tests.drivers.conftest import Play


def test_a_transcript_of_a_turn(play: Play) -> None:
    device = ViciInjection(play("vici_injection"), {"load_position": "A"})
    device.connect()
    assert device.select_position("inject").evidence == {"position": "inject"}


def test_the_plumbing_says_which_position_loads(play: Play) -> None:
    text = "> GOA\\r\n> CP\\r\n< CPA\\r\\n\n> CP\\r\n< CPA\\r\\n\n"
    device = ViciInjection(play(text=text), {"load_position": "B"})
    assert device.select_position("inject").evidence == {"position": "inject"}


def test_without_it_nothing_is_guessed(play: Play) -> None:
    with pytest.raises(DefinitionError, match="load_position"):
        ViciInjection(play(text=""), {})


def test_a_multiposition_valve_is_refused(play: Play) -> None:
    with pytest.raises(RejectedError):
        ViciInjection(play(text="> CP\\r\n< CP03\\r\\n\n"), {"load_position": "A"}).connect()
