"""What is solid stays on a filter, and what is wet dries; the plumbing is drawn in `solids`."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.workflows.compile_workflow import compile_workflow
from labweb.domain.workflows.plan import LotStatement, Plan
from labweb.domain.workflows.plan_proof.prove_workflow import prove_plan
from tests.domain.workflows.solids import (
    WET,
    codes,
    drying,
    filter_file,
    filter_lab,
    filtering,
    on,
    planned,
    steps,
)


def drawn(jobs: Any) -> list[TransferLiquid]:  # noqa: ANN401 - jobs of a plan
    return [one.operation for one in jobs if isinstance(one.operation, TransferLiquid)]


def carrying(**more: Any) -> tuple[str, dict[str, Any]]:  # noqa: ANN401 - what a step takes
    params = {"source": "@separator", "target": "@reactor", "volume": "20 mL"}
    return "transfer", {**params, **more}


def carried_ug(moves: list[TransferLiquid]) -> int:
    return sum(sum(one.carries_ug.values()) for one in moves)


def test_all_liquid_of_a_filter_is_drawn_off_and_the_solid_that_is_stated_stays() -> None:
    plan, proof = planned(steps(filtering()), filter_lab(WET))
    moves = drawn(plan.jobs)
    (salt,) = (str(lot.id) for lot in filter_file().lots if lot.key == "salt")
    assert sum(one.amount_nl for one in moves[::2]) == 30_000_000
    assert {tuple(map(str, one.keeps)) for one in moves[::2]} == {(salt,)}
    assert not any(one.keeps for one in moves[1::2])
    assert not proof.findings
    assert proof.covered == ("s0",)
    assert not proof.beyond


def test_what_of_a_solid_passes_a_filter_is_what_does_not_stay() -> None:
    plan, proof = planned(steps(filtering(stays={"salt": "200 mg"})), filter_lab(WET))
    moves = drawn(plan.jobs)
    assert carried_ug(moves[::2]) == carried_ug(moves[1::2]) == 300_000
    assert not any(one.keeps for one in moves)
    assert (proof.findings, proof.covered, proof.beyond) == ((), ("s0",), ())


def test_a_dissolved_solid_goes_along_stroke_by_stroke_to_the_last_microgram() -> None:
    plan, proof = planned(
        steps(carrying(solids={"salt": "100.001 mg"}, volume="all")), filter_lab(WET)
    )
    moves = drawn(plan.jobs)
    parts = [sum(one.carries_ug.values()) for one in moves[::2]]
    assert len(parts) > 1
    assert max(parts) - min(parts) <= 1
    assert carried_ug(moves[::2]) == carried_ug(moves[1::2]) == 100_001
    assert (proof.findings, proof.covered, proof.beyond) == ((), ("s0",), ())


def test_a_solid_of_which_nothing_goes_along_stays() -> None:
    plan, proof = planned(steps(carrying(solids={"salt": "none"})), filter_lab(WET))
    (draw, *_) = drawn(plan.jobs)
    assert (draw.carries_ug, len(draw.keeps)) == ({}, 1)
    assert not proof.findings
    whole, _ = planned(steps(carrying(solids={"salt": "all"})), filter_lab(WET))
    assert carried_ug(drawn(whole.jobs)[::2]) == 500_000


def changed(plan: Plan, at: str, solids: Any) -> Plan:  # noqa: ANN401 - as an operation has them
    """Return a plan of which the first stroke of a kind books other solids."""
    jobs = list(plan.jobs)
    place = next(n for n, one in enumerate(jobs) if one.action == at)
    (move,) = drawn([jobs[place]])
    jobs[place] = replace(jobs[place], operation=replace(move, **solids))
    return replace(plan, jobs=tuple(jobs))


def test_a_push_that_books_other_solids_than_were_drawn_is_not_proved() -> None:
    document, view = steps(carrying(solids={"salt": "100 mg"})), filter_lab(WET)
    plan = compile_workflow(on(document), view)
    (salt,) = drawn(plan.jobs)[0].carries_ug
    wrong = changed(plan, "dispense", {"carries_ug": {salt: 20_000}})
    found = prove_plan(on(document), wrong, view).findings
    assert any("other solids than were drawn" in one.message for one in found)


def test_a_plan_that_leaves_some_of_what_is_all_is_not_proved() -> None:
    document, view = steps(carrying(solids={"salt": "all"})), filter_lab(WET)
    plan = compile_workflow(on(document), view)
    (salt,) = drawn(plan.jobs)[0].carries_ug
    for at in ("aspirate", "dispense"):
        plan = changed(plan, at, {"carries_ug": {salt: 20_000}})
    found = prove_plan(on(document), plan, view).findings
    assert any("some stays" in one.message for one in found)


def test_a_plan_that_carries_what_nobody_stated_is_not_proved() -> None:
    document, view = steps(carrying()), filter_lab(WET)
    plan = compile_workflow(on(document), view)
    unasked = replace(plan, jobs=tuple(one for one in plan.jobs if not one.asks))
    assert prove_plan(on(document), unasked, view).findings


def test_of_what_is_not_there_nothing_goes_along() -> None:
    plan, proof = planned(steps(carrying(solids={"salt": "none", "sand": "none"})), filter_lab(WET))
    assert len(drawn(plan.jobs)[0].keeps) == 1
    assert not proof.findings


@pytest.mark.parametrize("wrong", ["more", "less", "none", "unstated"])
def test_a_plan_that_carries_another_mass_than_is_stated_is_not_proved(wrong: str) -> None:
    document, view = steps(carrying(solids={"salt": "100 mg"})), filter_lab(WET)
    plan = compile_workflow(on(document), view)
    jobs = list(plan.jobs)
    place = next(n for n, one in enumerate(jobs) if drawn([one]))
    (move,) = drawn([jobs[place]])
    (salt,) = move.carries_ug
    part = move.carries_ug[salt]
    masses = {"more": {salt: part + 7}, "less": {salt: part - 7}, "none": {salt: 0}}
    changed = replace(move, carries_ug=masses.get(wrong, {}))
    jobs[place] = replace(jobs[place], operation=changed)
    found = prove_plan(on(document), replace(plan, jobs=tuple(jobs)), view).findings
    assert any("of solid" in one.message and "µg go over" in one.message for one in found)


def test_where_nobody_states_it_the_run_asks_and_half_of_it_is_planned() -> None:
    for step, field in ((carrying(), "solids"), (("filter", bare()), "stays")):
        plan, proof = planned(steps(step), filter_lab(WET))
        (asking,) = (one for one in plan.jobs if one.asks)
        assert isinstance(asking.states, LotStatement)
        assert (asking.states.field, asking.states.leaves_out) == (field, False)
        assert carried_ug(drawn(plan.jobs)[::2]) == 250_000
        assert [one.step_id for one in proof.beyond] == ["s0"]


def bare() -> dict[str, str]:
    return {"vessel": "@separator", "target": "@waste"}


def test_a_dissolved_solid_lies_in_a_layer_as_far_as_it_is_stated() -> None:
    params = {"vessel": "@separator", "target": "@reactor", "settle_for": "5 min"}
    for text, mass_ug in (("120 mg", 120_000), ("all", 500_000), ("none", 0), (None, 0)):
        lower = {"ether": "10 mL"} | ({} if text is None else {"salt": text})
        plan, proof = planned(steps(("separate", {**params, "lower": lower})), filter_lab(WET))
        moves = drawn(plan.jobs)
        assert carried_ug(moves[::2]) == mass_ug, text
        assert sum(one.amount_nl for one in moves[::2]) == 10_000_000
        assert (proof.findings, proof.covered) == ((), ("s0",)), text
        assert any("salt is solid and stays" in one for one in plan.notes) is (text is None)


def test_what_was_dissolved_is_in_the_next_vessel() -> None:
    onward = ("transfer", {"source": "@reactor", "target": "@waste", "volume": "all"})
    first = carrying(solids={"salt": "120 mg"})
    assert "plan.solid_not_stated" in codes(
        steps(first, (*onward[:1], {**onward[1], "solids": {}})), filter_lab(WET)
    )
    plan, _ = planned(steps(first, onward), filter_lab(WET))
    assert [one.step_id for one in plan.jobs if one.asks] == ["s1"]


def test_a_vacuum_behind_a_valve_is_joined_before_it_is_drawn() -> None:
    plan = compile_workflow(on(steps(drying(vessel="@reactor"))), filter_lab())
    acts = [(job.action, job.args.get("port_index")) for job in plan.jobs]
    assert acts == [("select_port", 1), ("evacuate_to", None), ("wait", None), ("vent", None)]
    assert len({node for job in plan.jobs[:3] for node in job.locks}) > 3


def test_where_nothing_is_solid_by_the_record_the_plan_says_that_all_passes() -> None:
    lab = filter_file(is_plain=True)
    document = steps(("filter", {"vessel": "@separator", "target": "@waste"}))
    plan = compile_workflow(on(document, lab), filter_lab(WET, lab))
    assert any("all of it passes the filter" in note for note in plan.notes)


@pytest.mark.parametrize(
    ("step", "code"),
    [
        (filtering(stays={}), "plan.solid_not_stated"),
        (filtering(stays={"salt": "501 mg"}), "crutd.insufficient_mass"),
        (filtering(stays={"salt": "0 mg"}), "unit.not_positive"),
        (carrying(solids={}), "plan.solid_not_stated"),
        (carrying(solids={"salt": "501 mg"}), "crutd.insufficient_mass"),
        (carrying(solids={"ether": "all"}), "crutd.insufficient_mass"),
        (filtering(stays={"gold": "all"}), "plan.no_lot"),
        (filtering(stays={"salt": "all", "sand": "all"}), "crutd.insufficient_mass"),
        (filtering(stays={"salt": "all", "ether": "all"}), "crutd.insufficient_mass"),
        (filtering(vessel="@crude"), "plan.no_filter"),
        (filtering(target="@bottle_dcm"), "plan.needs_relay"),
        (drying(), "plan.not_empty"),
        (drying(dries_off={}), "plan.not_empty"),
        (drying(dries_off={"ether": "all"}), "plan.no_condenser"),
        (drying(receiver="@crude"), "plan.no_condenser"),
        (drying(dries_off={"ether": "all"}, receiver="@waste"), "plan.no_condenser"),
        (
            drying(dries_off={"ether": "31 mL"}, receiver="@crude"),
            "crutd.insufficient_volume",
        ),
        (drying(vessel="@crude"), "plan.no_device"),
    ],
)
def test_what_is_not_stated_or_cannot_be_is_refused(step: Any, code: str) -> None:  # noqa: ANN401 - a step
    assert code in codes(steps(step), filter_lab(WET))


def test_a_filter_without_liquid_has_nothing_to_draw_off() -> None:
    assert "crutd.insufficient_volume" in codes(steps(filtering()), filter_lab())


def test_a_way_that_leaves_above_the_frit_is_refused() -> None:
    lab = filter_file(port="side")
    document = steps(filtering())
    with pytest.raises(Exception, match="not below its frit"):
        compile_workflow(on(document, lab), filter_lab(WET, lab))


def test_after_a_filtration_a_solid_dries_without_a_statement() -> None:
    plan, proof = planned(steps(filtering(), drying()), filter_lab(WET))
    dry = [job for job in plan.jobs if job.step_id == "s1"]
    assert [job.action for job in dry] == ["evacuate_to", "wait", "vent"]
    assert dry[0].args["pressure_kpa"] == pytest.approx(40.0)
    assert not drawn(dry)
    assert sum(job.estimate_s for job in dry) > 600
    assert not proof.findings
    assert proof.covered == ("s0",)


def test_what_dries_off_goes_into_the_trap_at_the_end_of_the_time() -> None:
    step = drying(dries_off={"ether": "20 mL"}, receiver="@crude")
    plan, proof = planned(steps(step), filter_lab(WET))
    (moved,) = drawn(plan.jobs)
    assert moved.amount_nl == 20_000_000
    assert not proof.findings
    assert proof.covered == ("s0",)


def test_a_plan_that_dries_off_another_amount_is_not_proved() -> None:
    step = drying(dries_off={"ether": "20 mL"}, receiver="@crude")
    workflow, view = on(steps(step)), filter_lab(WET)
    plan = compile_workflow(workflow, view)
    jobs = tuple(
        replace(
            job,
            operation=replace(
                job.operation,
                amount_nl=10_000_000,
                parts_nl=dict.fromkeys(job.operation.parts_nl, 10_000_000),
            ),
        )
        if isinstance(job.operation, TransferLiquid)
        else job
        for job in plan.jobs
    )
    found = prove_plan(workflow, replace(plan, jobs=jobs), view).findings
    assert {one.code for one in found} == {"plan.not_proved"}


def test_a_plan_that_draws_only_a_part_of_a_filter_is_not_proved() -> None:
    workflow, view = on(steps(filtering())), filter_lab(WET)
    plan = compile_workflow(workflow, view)
    strokes = [job for job in plan.jobs if job.action in {"aspirate", "dispense"}]
    left = {job.index for job in strokes[-2:]}
    less = replace(plan, jobs=tuple(job for job in plan.jobs if job.index not in left))
    found = prove_plan(workflow, less, view).findings
    assert any("may be left in" in one.message for one in found)


def test_a_plan_that_draws_a_filter_empty_above_its_frit_is_not_proved() -> None:
    """The paper knows the solid and the port: the same jobs on other plumbing carry it along."""
    document, view = steps(filtering()), filter_lab(WET)
    plan = compile_workflow(on(document), view)
    other = filter_lab(WET, filter_file(port="side"))
    found = prove_plan(on(document), plan, other).findings
    assert any("not below its frit" in one.message for one in found)


def test_solids_stay_in_a_flask_that_is_boiled_down() -> None:
    step = drying(dries_off={"ether": "all"}, receiver="@crude")
    plan, _ = planned(steps(step), filter_lab(WET))
    (moved,) = drawn(plan.jobs)
    assert len(moved.keeps) == 1


def test_heating_is_switched_off_and_the_stirrer_goes_on() -> None:
    document = steps(("stop_heat", {"vessel": "@reactor"}))
    plan = compile_workflow(on(document), filter_lab())
    assert [job.action for job in plan.jobs] == ["stop_control"]
    assert codes(steps(("stop_heat", {"vessel": "@separator"})), filter_lab()) == {"plan.no_device"}


def test_a_temperature_is_reached_as_near_as_the_step_says() -> None:
    warm = {"vessel": "@reactor", "temperature": "40 °C"}
    for more, tolerance_c in (({}, 1.0), ({"tolerance": "0.5 K"}, 0.5)):
        plan = compile_workflow(on(steps(("heat_chill", {**warm, **more}))), filter_lab())
        assert plan.jobs[0].args["tolerance_c"] == tolerance_c
        assert plan.jobs[0].post[0].tolerance == tolerance_c


def test_a_solid_that_a_reaction_makes_stays_on_the_filter() -> None:
    react = {
        "vessel": "@separator",
        "duration": "1 h",
        "consumed": {"ether": "10 mL"},
        "product": "crystals",
        "material": "sodium_chloride",
        "mass": "7 g",
        "residue": "60 mg",
        "reason": "a test",
    }
    made = ("react", react)
    unsaid = steps(made, filtering())
    assert "plan.solid_not_stated" in codes(unsaid, filter_lab(WET))
    stays = {"salt": "all", "crystals": "all"}
    plan, proof = planned(steps(made, filtering(stays=stays)), filter_lab(WET))
    moves = [one for one in drawn(plan.jobs) if one.keeps]
    assert {len(one.keeps) for one in moves} == {2}
    assert sum(one.amount_nl for one in moves) == 20_000_000
    assert not proof.findings
    assert proof.covered == ("s0", "s1")
    for more in ("2 g", "none", "all"):
        plan, proof = planned(
            steps(made, filtering(stays={"salt": "60 mg", "crystals": more})), filter_lab(WET)
        )
        assert (proof.findings, proof.covered) == ((), ("s0", "s1")), more


def test_what_of_a_solid_has_reacted_is_not_carried_along() -> None:
    react = {
        "vessel": "@separator",
        "duration": "1 h",
        "consumed": {"ether": "10 mL", "salt": "400 mg"},
        "product": "crystals",
        "material": "sodium_chloride",
        "mass": "7 g",
        "residue": "460 mg",
        "reason": "a test",
    }
    too_much = carrying(solids={"salt": "101 mg", "crystals": "none"})
    assert "crutd.insufficient_mass" in codes(steps(("react", react), too_much), filter_lab(WET))
    stays = filtering(stays={"salt": "60 mg", "crystals": "all"})
    _, proof = planned(steps(("react", react), stays), filter_lab(WET))
    assert (proof.findings, proof.covered) == ((), ("s0", "s1"))
