"""What a person states of matter is there, fits, and is what the step claims."""

from __future__ import annotations

from typing import Any

import pytest

from tests.domain.proof.bench import act, codes, plan, run, shift, step

MIXED = {"water": 6_000.0, "ether": 4_000.0}


def become(vessel: str = "reactor", to: str | None = None, **lots: dict[str, float]) -> Any:  # noqa: ANN401 - JSON
    """A step that claims what it does."""
    ends = {} if to is None else {"to": to}
    said = {"vessel": vessel, **ends, **lots}
    return step("become", [[act("@declared become", **said)]], **said)


def layer(*strokes: float, of: dict[str, float], lots: dict[str, float] | None = None) -> Any:  # noqa: ANN401 - JSON
    return step(
        "transfer",
        shift("0", "2", *strokes, of=of),
        from_="reactor",
        to="waste",
        volume_ul=sum(strokes),
        lots=of if lots is None else lots,
    )


def held(wanted: dict[str, Any], key: str) -> dict[str, float]:
    contents = run(wanted).contents[key]
    return {lot: amount.most / 1e9 for lot, amount in contents.liquids.items() if amount.most}


def test_what_reacts_is_gone_and_what_is_made_is_there() -> None:
    done = plan(become(takes={"water": 2_000}, gives={"salt water": 2_100}), reactor=MIXED)
    assert codes(done) == set()
    assert held(done, "reactor") == {"water": 4_000, "ether": 4_000, "salt water": 2_100}


def test_what_boils_off_is_in_the_other_vessel() -> None:
    done = plan(become(to="waste", takes={"ether": 4_000}, gives={"ether": 4_000}), reactor=MIXED)
    assert codes(done) == set()
    assert held(done, "reactor") == {"water": 6_000}
    assert held(done, "waste") == {"ether": 4_000}


def test_a_layer_is_drawn_lot_by_lot_and_the_rest_stays() -> None:
    done = plan(layer(4_000, of={"ether": 4_000}), reactor=MIXED)
    assert codes(done) == set()
    assert held(done, "reactor") == {"water": 6_000}
    assert held(done, "waste") == {"ether": 4_000}


@pytest.mark.parametrize(
    ("name", "wrong", "code"),
    [
        (
            "more reacts than is there",
            [become(takes={"water": 6_001}, gives={})],
            "interpret.not_there",
        ),
        ("a lot that is not there", [become(takes={"dye": 1}, gives={})], "interpret.not_there"),
        (
            "what is made does not fit",
            [become(takes={}, gives={"gas": 95_000})],
            "interpret.overflow",
        ),
        (
            "a layer of another lot",
            [layer(4_000, of={"ether": 4_000}, lots={"water": 4_000})],
            "interpret.claim",
        ),
        (
            "more of a layer than there is",
            [layer(5_000, of={"ether": 5_000})],
            "interpret.not_there",
        ),
        ("lots of another volume", [layer(4_000, of={"ether": 3_000})], "interpret.unclaimed"),
        ("into no vessel", [become(to="pump_1", takes={}, gives={})], "interpret.unknown_vessel"),
    ],
)
def test_what_is_stated_and_is_not_so_is_refused(
    name: str, wrong: list[dict[str, Any]], code: str
) -> None:
    assert code in codes(plan(*wrong, reactor=MIXED)), name


def test_what_becomes_is_what_the_step_claims_once() -> None:
    right = become(takes={"water": 1_000}, gives={"salt": 1_000})
    other = become(takes={"water": 1_000}, gives={"salt": 2_000})
    cases: list[list[Any]] = [other["actions"], [], right["actions"] * 2]
    for actions in cases:
        wrong = {"does": right["does"], "actions": actions}
        assert "interpret.claim" in codes(plan(wrong, reactor=MIXED)), actions
