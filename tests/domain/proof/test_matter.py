"""Matter is conserved, and what is true is never outside what is said."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, AmountRange, Contents
from labweb.domain.proof.plan_state import State
from tests.domain.proof.bench import by_hand, carry, plan, run, shift, step
from tests.domain.proof.plans import (
    EMPTY,
    EVAPORATE,
    FILTERING,
    SEPARATE,
    VACUUM,
    VENT,
)

LOTS = ("water", "ether", "solid_salt")
amounts = st.floats(0, 30_000).map(lambda amount: float(round(amount)))
contents = st.dictionaries(st.sampled_from(LOTS), amounts, max_size=3)
volumes = st.integers(1, 10_000_000).map(lambda volume_nl: volume_nl / 1000)


def _transfer(groups: list[Any]) -> dict[str, Any]:
    return step("transfer", groups, **{"from": "reactor", "to": "waste", "volume_ul": 1})


ports = st.sampled_from("01235")
certain = st.one_of(
    st.builds(lambda a, b, v: _transfer(shift(a, b, v)), ports, ports, volumes),
    st.builds(lambda a, b, v: _transfer(carry(a, b, v)), st.sampled_from("01"), ports, volumes),
    st.builds(lambda a, b, v: _transfer(shift(a, b, v, until="empty")), ports, ports, volumes),
    st.sampled_from([EMPTY, FILTERING]),
    st.builds(
        lambda v: step(
            "fill",
            [[by_hand("fill", vessel="reactor", lot="water", volume_ul=v)]],
            to="reactor",
            lot="water",
            volume_ul=v,
        ),
        volumes,
    ),
)
uncertain = st.sampled_from([SEPARATE, EVAPORATE, VACUUM, VENT])
VESSELS = ("flask_water", "flask_ether", "reactor", "filter", "separator", "rotavap", "waste")
fillings = st.fixed_dictionaries({}, optional=dict.fromkeys(VESSELS, contents))


def introduced(wanted: dict[str, Any]) -> dict[str, int]:
    """Units of each lot that were there or were filled in."""
    sums: dict[str, int] = {}
    for lots in wanted["contents"].values():
        for one in lots:
            grain = 1000 * UNITS_PER_NL if one["phase"] == "liquid" else UNITS_PER_NL
            amount = one.get("volume_ul", one.get("mass_ug"))
            sums[one["lot"]] = sums.get(one["lot"], 0) + round(amount * grain)
    for one in wanted["steps"]:
        if one["does"]["kind"] == "fill":
            amount = round(one["does"]["volume_ul"] * 1000) * UNITS_PER_NL
            sums["water"] = sums.get("water", 0) + amount
    return sums


def everywhere(state: State) -> dict[str, AmountRange]:
    """Each lot in all vessels, syringes and cartridges, and what dried away or was thrown away."""
    places = [*state.contents.values(), *(one.contents for one in state.syringes.values())]
    sums: dict[str, AmountRange] = {}
    for held in places:
        for lot, amount in (*held.liquids.items(), *held.solids.items()):
            sums[lot] = sums.get(lot, AmountRange(0, 0)) + amount
    return sums


@settings(max_examples=60, deadline=None)
@given(st.lists(certain, max_size=8), fillings)
def test_of_what_is_certain_every_unit_stays(
    steps: list[dict[str, Any]], held: dict[str, dict[str, float]]
) -> None:
    wanted = plan(*steps, **held)
    found = everywhere(run(wanted))
    assert {lot: amount for lot, amount in found.items() if amount.most} == {
        lot: AmountRange.exactly(amount) for lot, amount in introduced(wanted).items() if amount
    }


@settings(max_examples=60, deadline=None)
@given(st.lists(st.one_of(certain, uncertain), max_size=8), fillings)
def test_of_what_is_uncertain_the_sum_lies_between_least_and_most(
    steps: list[dict[str, Any]], held: dict[str, dict[str, float]]
) -> None:
    wanted = plan(*steps, **held)
    found = everywhere(run(wanted))
    for lot, amount in introduced(wanted).items():
        known = found.get(lot, AmountRange(0, 0))
        assert known.least <= amount <= known.most


@settings(max_examples=200, deadline=None)
@given(
    st.dictionaries(st.sampled_from("abc"), st.integers(0, 1000), min_size=1),
    st.lists(st.tuples(st.integers(1, 900), st.randoms(use_true_random=False)), max_size=6),
)
def test_what_is_truly_there_is_never_outside_least_and_most(
    lots: dict[str, int], draws: list[tuple[int, Any]]
) -> None:
    held = Contents()
    for lot, amount in lots.items():
        held.add(Contents({lot: AmountRange.exactly(amount)}, {}, AmountRange.exactly(amount)))
    held.take_lower_phase(0)
    truth = dict(lots)
    for volume, random in draws:
        taken = held.take_lower_phase(volume)
        true_taken = {}
        room = volume
        for lot in truth:
            true_taken[lot] = random.randint(0, min(room, truth[lot]))
            room -= true_taken[lot]
            truth[lot] -= true_taken[lot]
        for said, true in ((taken, true_taken), (held, truth)):
            assert said.volume.least <= sum(true.values()) <= said.volume.most
            for lot, amount in true.items():
                known = said.liquids.get(lot, AmountRange(0, 0))
                assert known.least <= amount <= known.most


def test_of_no_lot_is_there_more_than_the_limit_says() -> None:
    held = Contents(
        {"a": AmountRange(0, 50), "b": AmountRange(0, 50)},
        {"s": AmountRange(0, 9)},
        AmountRange(0, 60),
    )
    held.keep_within(
        Contents({"a": AmountRange(5, 20)}, {"s": AmountRange(3, 3)}, AmountRange(5, 20))
    )
    assert held.liquids == {"a": AmountRange(0, 20), "b": AmountRange(0, 0)}
    assert (held.solids, held.volume) == ({"s": AmountRange(0, 3)}, AmountRange(0, 20))
