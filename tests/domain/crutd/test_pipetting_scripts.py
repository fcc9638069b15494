"""Published pipetting scripts of PyLabRobot: every outcome and every volume is also ours.

One thing is not: PyLabRobot 0.2.2 books a step on the well first and on the tip second, and
where the tip refuses, the booking on the well stays. Its wells then hold liquid that was never
there, or lack liquid that never left. The tests follow these phantoms to the last nanolitre.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any
from uuid import UUID, uuid5

import pytest

from labweb.domain.crutd import pipette_tips
from labweb.domain.crutd.operations import Operation
from labweb.domain.errors import Finding, PreconditionError
from labweb.domain.resources.labware.labware_resources import LabwareIdentity, part_resources
from labweb.domain.resources.labware.pylabrobot import parse_pylabrobot
from labweb.domain.resources.resource import Resource
from tests.corpus import LABWARE, NO_LABWARE
from tests.domain.crutd.pipetting import CHANNEL, Record
from tests.domain.resources.labware_files import PYLABROBOT, load

pytestmark = pytest.mark.skipif(not LABWARE.is_dir(), reason=NO_LABWARE)

SCRIPTS = sorted(PYLABROBOT.glob("plr_scenario_*.json"))

CODES = {
    "NoTipError": "crutd.no_tip",
    "HasTipError": "crutd.has_tip",
    "TooLittleLiquidError": "crutd.insufficient_volume",
    "TooLittleVolumeError": "crutd.capacity_exceeded",
    # Cannot drop a tip with liquid in it.
    "RuntimeError": "crutd.tip_holds_liquid",
}
OTHER_REASON = {
    # Refused by both. Here a phantom in the well is its reason, and the tip is ours.
    ("plr_scenario_ot_012", 24): "crutd.insufficient_volume",
    ("plr_scenario_ot_015", 16): "crutd.capacity_exceeded",
    ("plr_scenario_ot_017", 20): "crutd.insufficient_volume",
    ("plr_scenario_ot_017", 29): "crutd.insufficient_volume",
    ("plr_scenario_star_115", 17): "crutd.insufficient_volume",
    ("plr_scenario_star_116", 29): "crutd.insufficient_volume",
}
"""Script and step of every refusal that PyLabRobot gives another reason for."""

DECK = uuid5(UUID(int=0), "deck")


@cache
def rows_of(deck: str) -> tuple[Resource, ...]:
    part, notes = parse_pylabrobot(load(PYLABROBOT / f"plr_deck_{deck}.json"))
    assert notes == []
    identity = LabwareIdentity(id=DECK, key="deck", name="Deck", parent_id=None)
    return part_resources(part, identity, partial(uuid5, DECK), full_racks={"tips"})


class Script:
    """One published script, done step by step by our rules alone."""

    def __init__(self, value: dict[str, Any]) -> None:
        self.value = value
        rows = rows_of(value["deck_kind"])
        self.ids = {row.key.rpartition("deck/")[2]: row.id for row in rows}
        self.record = Record.of(rows)
        for well, amount_ul in value["initial_uL"].items():
            self.record.fill(self.id(well), nl(amount_ul))
        self.home: UUID | None = None
        self.phantoms: Counter[str] = Counter()

    def id(self, name: str) -> UUID:
        """Return our id of what PyLabRobot calls `plateA_well_A1` or `tips_tipspot_A1`."""
        labware, _, address = name.split("_")
        (found,) = [v for k, v in self.ids.items() if k.endswith(f"{labware}/{address}")]
        return found

    def act(self, step: dict[str, Any]) -> list[Finding]:
        """Do one step; return why it is refused."""
        try:
            for make in self.operations(step):
                self.record.carry_out(make())
        except PreconditionError as error:
            return list(error.findings)
        return []

    def book_phantom(self, step: dict[str, Any], findings: list[Finding]) -> None:
        """Keep what PyLabRobot books on a well for a step that the tip refuses."""
        tip = self.record.tip
        blamed = {finding.code for finding in findings if tip and finding.subject == tip.name}
        if CODES[step["result"]] not in blamed:
            return
        if step["op"] == "disp":
            self.phantoms[step["well"]] += nl(step["vol"])
        elif step["op"] == "asp":
            self.phantoms[step["well"]] -= nl(step["vol"])
        elif step["op"] == "transfer":
            self.phantoms[step["source"]] -= nl(sum(step["target_vols"]))

    def operations(self, step: dict[str, Any]) -> list[Callable[[], Operation]]:
        states = self.record.states
        match step["op"]:
            case "pick":
                spot = self.id(step["tip"])
                if self.record.tip is None:
                    self.home = spot
                return [lambda: pipette_tips.mount(spot, CHANNEL, states)]
            case "drop":
                assert step["to"] == "return"
                assert self.home is not None
                home, is_agreed = self.home, step["allow_nonzero_volume"]
                return [
                    lambda: pipette_tips.put_away(CHANNEL, home, states, may_hold_liquid=is_agreed)
                ]
            case "asp":
                return [self.draw(step["well"], step["vol"])]
            case "disp":
                return [self.give(step["well"], step["vol"])]
        assert step["op"] == "transfer"
        shares = zip(step["targets"], step["target_vols"], strict=True)
        given = [self.give(target, volume) for target, volume in shares]
        return [self.draw(step["source"], sum(step["target_vols"])), *given]

    def draw(self, well: str, volume_ul: float) -> Callable[[], Operation]:
        return lambda: pipette_tips.draw(CHANNEL, self.id(well), nl(volume_ul), self.record.states)

    def give(self, well: str, volume_ul: float) -> Callable[[], Operation]:
        return lambda: pipette_tips.give(CHANNEL, self.id(well), nl(volume_ul), self.record.states)


def nl(volume_ul: float) -> int:
    amount = volume_ul * 1000
    assert amount == int(amount)
    return int(amount)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_ends_every_step_as_published(path: Path) -> None:
    script = Script(load(path))
    record = script.record
    total = record.total_nl()
    for place, step in enumerate(script.value["ops"]):
        findings = script.act(step)
        codes = {finding.code for finding in findings}
        if step["result"] == "ok":
            assert not codes, (place, step)
        elif (path.stem, place) in OTHER_REASON:
            assert codes == {OTHER_REASON[path.stem, place]}, (place, step)
            assert script.phantoms[step["well"]] != 0
        else:
            assert CODES[step["result"]] in codes, (place, step, codes)
            script.book_phantom(step, findings)
        assert (record.tip is not None) == step["tip_mounted"], (place, step)
        if record.tip is not None:
            assert record.held_nl(record.tip.id) == nl(step["tip_volume"]), (place, step)
        assert record.total_nl() == total, (place, step)
    final = script.value["final_uL"]
    for row in rows_of(script.value["deck_kind"]):
        if row.kind == "well":
            plate, address = row.key.split("/")[-2:]
            name = f"{plate}_well_{address}"
            told = nl(final.get(name, 0))
            assert record.held_nl(row.id) == told - script.phantoms[name], name


def test_the_scripts_hold_every_kind_of_refusal() -> None:
    results = Counter(step["result"] for path in SCRIPTS for step in load(path)["ops"])
    assert results.keys() == {"ok", *CODES}
    assert sum(results.values()) == 24 * 30
