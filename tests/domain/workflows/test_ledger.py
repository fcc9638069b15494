from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from labweb.domain.resources.contents_by_lot import LotId
from tests.domain.workflows.asking import (
    codes_of,
    findings_of,
    moved_nl,
    plan_of,
)
from tests.domain.workflows.bench import (
    a_bench,
    chain,
    device_id_of,
    flow,
    id_of,
    transfer,
)


def test_too_little_and_too_much_are_both_told_and_by_how_much() -> None:
    bench = a_bench()
    bench.vessel("vial", 900_000, capacity_nl=1_000_000, kind="vial")
    bench.vessel("cup", 100_000)
    bench.pump(2, {1: ("cup", 0), 2: ("vial", 0)})
    found = findings_of(bench, flow(transfer("t", "cup", "vial", "0.5 mL")))
    assert [f.code for f in found] == ["crutd.insufficient_volume", "crutd.capacity_exceeded"]
    assert {(f.subject, f.context["field"]) for f in found} == {("t", "params.volume")}
    assert found[0].context["usable_nl"] == 100_000
    assert found[1].context["free_nl"] == 100_000


def test_what_an_earlier_step_took_is_missing_later() -> None:
    bench = a_bench()
    value = chain(
        transfer("a", "water", "reactor", "30 mL"),
        transfer("b", "reactor", "flask", "20 mL"),
        transfer("c", "reactor", "flask", "20 mL"),
    )
    assert codes_of(bench, value) == [("c", "crutd.insufficient_volume")]
    fits = chain(*value["steps"][:2], transfer("c", "reactor", "flask", "10 mL"))
    assert moved_nl(plan_of(bench, fits), "pump_1", "flask") == 30_000_000


def test_after_a_broken_step_amounts_are_not_judged_but_other_reasons_are() -> None:
    bench = a_bench()
    bench.states[id_of("dye")] = replace(bench.states[id_of("dye")], quarantined_by="tx-1")
    value = chain(
        transfer("a", "water", "reactor", "500 mL"),
        transfer("b", "reactor", "flask", "5 mL"),
        transfer("c", "dye", "flask", "1 mL"),
    )
    assert codes_of(bench, value) == [
        ("a", "crutd.insufficient_volume"),
        ("a", "crutd.capacity_exceeded"),
        ("c", "crutd.quarantined"),
    ]


def test_what_follows_from_a_broken_step_is_not_judged_either() -> None:
    bench = a_bench()
    state = bench.states[id_of("reactor")]
    bench.states[id_of("reactor")] = replace(state, contents={LotId("water"): 1_000_000})
    value = chain(
        transfer("a", "water", "reactor", "200 mL"),
        transfer("b", "reactor", "flask", "0.5 mL"),
        transfer("c", "flask", "dye", "2 mL"),
    )
    assert codes_of(bench, value) == [("a", "crutd.capacity_exceeded")]


@pytest.mark.parametrize(
    ("change", "code"),
    [({"quarantined_by": "tx-1"}, "crutd.quarantined"), ({"is_archived": True}, "crutd.archived")],
)
@pytest.mark.parametrize("key", ["water", "reactor", "valve_1"])
def test_closed_resources_stop_the_plan(change: dict[str, Any], code: str, key: str) -> None:
    bench = a_bench()
    bench.states[id_of(key)] = replace(bench.states[id_of(key)], **change)
    value = flow(transfer("t", "water", "reactor", "1 mL"))
    assert ("t", code) in codes_of(bench, value)


def test_a_vessel_of_unknown_capacity_is_not_filled() -> None:
    bench = a_bench()
    state = bench.states[id_of("reactor")]
    bench.states[id_of("reactor")] = replace(state, capacity_nl=None)
    value = flow(transfer("t", "water", "reactor", "1 mL"))
    (finding,) = findings_of(bench, value)
    assert (finding.code, finding.context["field"]) == (
        "crutd.unknown_capacity",
        "params.target",
    )


def test_a_balance_confirms_each_stroke_by_mass() -> None:
    value = flow(transfer("t", "water", "flask", "8 mL", confirm_with="@balance_1"))
    plan = plan_of(a_bench(), value)
    pushes = [job for job in plan.jobs if job.action == "dispense"]
    assert len(pushes) == 2
    for job in pushes:
        (mass,) = [condition for condition in job.post if condition.is_sensor]
        assert mass.device_id == device_id_of("balance_1")
        assert (mass.status, mass.stable_status, mass.timeout_s) == ("mass_mg", "is_stable", 15.0)
        assert mass.change == pytest.approx(4000 * 0.998)
        assert mass.tolerance == pytest.approx(39.92)
        assert id_of("balance_1") in job.locks
    small = flow(transfer("t", "water", "flask", "0.1 mL", confirm_with="@balance_1"))
    assert plan_of(a_bench(), small).jobs[3].post[-1].tolerance == 5.0


@pytest.mark.parametrize(
    ("given", "is_free"), [({}, False), ({"may_stay_unconfirmed": True}, True)]
)
def test_a_mass_has_to_be_confirmed_unless_the_step_says_that_it_need_not(
    given: dict[str, Any], is_free: bool
) -> None:
    value = flow(transfer("t", "water", "flask", "1 mL", confirm_with="@balance_1", **given))
    conditions = [one for job in plan_of(a_bench(), value).jobs for one in job.post]
    assert [one.may_stay_unconfirmed for one in conditions if one.is_sensor] == [is_free]
    assert not any(one.may_stay_unconfirmed for one in conditions if not one.is_sensor)


def test_a_transfer_that_asks_for_no_confirmation_has_none_that_may_stay_out() -> None:
    value = flow(transfer("t", "water", "flask", "1 mL", may_stay_unconfirmed=True))
    assert codes_of(a_bench(), value) == [("t", "plan.nothing_to_confirm")]
    value = flow(transfer("t", "water", "flask", "1 mL", may_stay_unconfirmed=False))
    assert plan_of(a_bench(), value).jobs


def test_a_mixture_weighs_what_its_parts_weigh() -> None:
    bench = a_bench()
    bench.densities[LotId("dye")] = 1.2
    value = chain(
        transfer("a", "water", "reactor", "3 mL"),
        transfer("b", "dye", "reactor", "1 mL"),
        transfer("c", "reactor", "flask", "2 mL", confirm_with="@balance_1"),
    )
    mass = plan_of(bench, value).jobs[-1].post[-1]
    assert mass.change == pytest.approx(1500 * 0.998 + 500 * 1.2)


def test_a_mass_cannot_be_confirmed_without_a_density() -> None:
    value = flow(transfer("t", "dye", "flask", "1 mL", confirm_with="@balance_1"))
    (finding,) = findings_of(a_bench(), value)
    assert (finding.code, finding.context["lots"]) == ("plan.unknown_density", ["dye"])


def test_a_mass_cannot_be_confirmed_by_a_balance_the_target_is_not_on() -> None:
    value = flow(transfer("t", "water", "reactor", "1 mL", confirm_with="@balance_1"))
    assert codes_of(a_bench(), value) == [("t", "plan.not_on_balance")]
