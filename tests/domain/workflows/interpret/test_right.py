"""Right plans are proved."""

from __future__ import annotations

import pytest

from tests.domain.workflows.interpret.bench import check, codes, draw, plan, port, push, run, step
from tests.domain.workflows.interpret.plans import ASK, EVAPORATE, OFF, RIGHT


@pytest.mark.parametrize("name", RIGHT)
def test_a_right_plan_is_proved(name: str) -> None:
    assert check(RIGHT[name]) == []


def test_what_may_be_on_a_vacuum_may_dry_up_until_it_is_taken_off() -> None:
    held = {"flask_g": {"ether": 5.0}}
    assert run(plan(OFF, ASK, **held)).held("flask_g").is_known
    assert not run(plan(ASK, OFF, **held)).held("flask_g").is_known


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
