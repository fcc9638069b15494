"""Right plans are proved."""

from __future__ import annotations

import pytest

from tests.domain.proof.bench import (
    act,
    carry,
    check,
    codes,
    draw,
    plan,
    port,
    push,
    run,
    step,
)
from tests.domain.proof.plans import (
    ASK,
    EVAPORATE,
    HEAT,
    OFF,
    REACH,
    RIGHT,
    ROTATE,
    STOP_HEAT,
    STOP_LIGHT,
    STOP_ROTATE,
    WAIT,
)
from tests.domain.proof.wrong_claims import lit, reach


@pytest.mark.parametrize("name", RIGHT)
def test_a_right_plan_is_proved(name: str) -> None:
    assert check(RIGHT[name]) == []


def test_what_may_be_on_a_vacuum_may_dry_up_until_it_is_taken_off() -> None:
    held = {"flask_g": {"ether": 5.0}}
    assert run(plan(OFF, ASK, **held)).held("flask_g").is_known
    assert not run(plan(ASK, OFF, **held)).held("flask_g").is_known


def test_a_wait_goes_on_beside_another_queue_and_beside_what_the_recipe_says_it_runs_beside() -> (
    None
):
    two = plan(HEAT, WAIT, ROTATE, STOP_HEAT, STOP_ROTATE)
    places = ({"queue": "a"}, {"queue": "a"}, {"queue": "b"}, {"queue": "a"}, {"queue": "b"})
    for one, where, after in zip(two["steps"], places, ([], [1], [], [2], [3]), strict=True):
        one |= {"of": {"operation": "Trial", **where}, "after": after}
    assert check(two) == []
    beside = plan(WAIT, HEAT, STOP_HEAT)
    beside["steps"][0]["of"]["beside"] = "a"
    for one, after in zip(beside["steps"], ([], [], [2]), strict=True):
        one["after"] = after
    assert check(beside) == []


def test_a_vessel_that_nothing_heats_drifts_to_the_room_by_what_is_on_its_way() -> None:
    drifting = (reach(45, 55), reach(29, 31), reach(20, 25))
    assert check(plan(HEAT, REACH, STOP_HEAT, *drifting)) == []
    assert check(plan(reach(24, 26))) == []


def test_a_light_may_be_claimed_with_all_that_is_known_of_it_and_changed_by_another_step() -> None:
    known = {"wavelength_nm": 450, "color": "blue", "power_w": 5, "intensity_percent": 40}
    groups = [[act("lamp start_light", **known)]]
    full = step("light", groups, vessel="reactor", **known)
    assert check(plan(full, lit(365, wavelength_nm=365), STOP_LIGHT)) == []


def test_gas_is_pushed_into_any_vessel() -> None:
    groups = carry("2", "0", 5_000)
    push_it = step("push", groups, from_="flask_n2", to="reactor", volume_ul=5_000)
    assert check(plan(push_it)) == []


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
