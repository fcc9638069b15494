"""The SY-03B pump and valve against bytes of its published command table."""

from __future__ import annotations

import pytest

from drivers.connectors.runze_sy03b import RunzeSy03b
from labweb.domain.errors import DefinitionError, PreconditionError
from tests.drivers.conftest import Play

CONFIG = {"syringe_ul": 1000.0, "ports_count": 8}


def test_a_transcript_from_connecting_to_a_stroke_in_6000_steps(play: Play) -> None:
    device = RunzeSy03b(play("runze_sy03b"), CONFIG)
    device.connect()
    assert device.initialize().moved_ul is None
    assert device.select_port(3).evidence == {"port_index": 3}
    report = device.aspirate(400.0, 500.0)
    assert report.moved_ul == 400.0
    assert report.evidence == {"steps_before": 0, "steps_after": 2400, "port_index": 3}


def test_a_rate_beyond_6000_steps_a_second_is_refused(play: Play) -> None:
    transport = play(text="")
    with pytest.raises(PreconditionError) as caught:
        RunzeSy03b(transport, CONFIG).aspirate(400.0, 1000.2)
    assert caught.value.code == "device.rate_out_of_range"
    assert transport.sent == []


def test_half_a_choice_of_initialisation_ports_is_refused(play: Play) -> None:
    with pytest.raises(DefinitionError):
        RunzeSy03b(play(text=""), {**CONFIG, "init_input_port_index": 1})
