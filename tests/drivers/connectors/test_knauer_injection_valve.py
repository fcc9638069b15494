"""The Azura injection valve against bytes of its published command table."""

from __future__ import annotations

import pytest

from drivers.connectors.knauer_injection_valve import KnauerInjectionValve
from labweb.domain.errors import FrameError, RejectedError
from tests.drivers.conftest import Play


def test_a_transcript_of_a_turn(play: Play) -> None:
    device = KnauerInjectionValve(play("knauer_injection_valve"), {})
    device.connect()
    assert device.select_position("inject").evidence == {"position": "inject"}


def test_a_multiposition_valve_is_refused(play: Play) -> None:
    with pytest.raises(RejectedError, match="VALVE LI"):
        KnauerInjectionValve(play(text="> T\\r\\n\n< VALVE 6\\r\\n\n"), {}).connect()


def test_a_position_that_is_neither_is_an_error(play: Play) -> None:
    with pytest.raises(FrameError):
        KnauerInjectionValve(play(text="> P\\r\\n\n< 3\\r\\n\n"), {}).position()
