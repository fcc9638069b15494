"""Right plans are proved."""

from __future__ import annotations

import pytest

from tests.domain.workflows.interpret.bench import check, codes, draw, plan, port, push, step
from tests.domain.workflows.interpret.plans import EVAPORATE, RIGHT


@pytest.mark.parametrize("name", RIGHT)
def test_a_right_plan_is_proved(name: str) -> None:
    assert check(RIGHT[name]) == []


@pytest.mark.parametrize("most_ul", [8_000, 7_999])
def test_what_boils_off_is_drawn_from_the_collecting_flask(most_ul: float) -> None:
    groups = [
        [port("valve_3", "5")],
        [draw("pump_3", 8_000, until="empty")],
        [port("valve_3", "2")],
        [push("pump_3", 8_000)],
    ]
    claim = {"from": "rotavap#collect", "to": "flask_c", "all": True, "most_ul": most_ul}
    wanted = plan(EVAPORATE, step("transfer", groups, **claim), rotavap={"ether": 8_000.0})
    expected = {"interpret.unknown_syringe"}  # nobody says how much pump_3 holds
    assert codes(wanted) == expected | ({"interpret.claim"} if most_ul < 8_000 else set())
