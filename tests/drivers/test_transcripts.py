"""Every driver makes what was recorded of it again: the same requests, the same values.

`tests/drivers/recording.py` recorded them against the simulated instruments.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import scan
from drivers.replay import replay
from tests.drivers.conftest import TRANSCRIPTS
from tests.drivers.recording import FOLDER, MODELS

RECORDED = sorted(FOLDER.glob("*.txt"), key=lambda path: path.name)

BY_HAND = {
    **{"tricontinent_c3000": "c3000_connect", "seer_agv": "seer_agv"},
    **{
        name: name
        for name in (
            *("chemputer_pump", "chemputer_valve", "hamilton_ml600", "harvard_elite_11"),
            *("idex_mxii", "knauer_azura_compact", "knauer_injection_valve", "knauer_valve"),
            *("masterflex_ls", "new_era_ne1000", "runze_sv06", "runze_sy01", "runze_sy03b"),
            *("vici_injection", "vici_multiposition", "watson_marlow_323"),
        )
    },
}
"""By driver: the transcript of its manual, which its own test replays."""

WITHOUT = {
    "drivers.virtual.timer": "it asks no device",
    "drivers.virtual.ros2_node": "what is told by itself is no exchange: tests/ros2",
}


def module_of(path: Path) -> str:
    with path.open(encoding="utf-8") as stream:
        return stream.readline().removeprefix("# ").partition(" ")[0]


@pytest.mark.parametrize("path", RECORDED, ids=lambda path: path.stem)
def test_a_driver_asks_the_same_again_and_comes_to_the_same(path: Path) -> None:
    assert replay(path.read_text(encoding="utf-8")) == []


def test_every_driver_has_a_transcript() -> None:
    assert {path.stem for path in RECORDED} == set(MODELS)
    by_hand = {name for name, text in BY_HAND.items() if (TRANSCRIPTS / f"{text}.txt").is_file()}
    every = {spec.module for spec in scan(PACKAGE).drivers}
    known = {module_of(path) for path in RECORDED} | set(WITHOUT)
    known |= {module for module in every if module.rpartition(".")[2] in by_hand}
    assert every == known
