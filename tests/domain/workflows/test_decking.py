"""What a pipetting robot moves between wells is booked from the one to the other."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import inspect_file
from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.enrollment.driver_spec import DriverSpec
from tests.domain.workflows.asking import actions, codes_of, plan_of
from tests.domain.workflows.bench import Bench, flow, id_of, step


def robot() -> DriverSpec:
    return inspect_file(PACKAGE / "processing" / "opentrons_ot2.py")


TIP = {"slot": "1", "well": "A1"}


@pytest.fixture
def bench() -> Bench:
    """A deck with a trough in slot 2 and a plate in slot 3; another plate stands beside it."""
    bench = Bench()
    bench.add("deck", "deck")
    for slot in ("2", "3"):
        bench.add(f"deck/{slot}", "slot", on="deck")
    bench.add("trough", "reservoir", on="deck/2")
    bench.add("plate", "plate", on="deck/3")
    bench.add("other", "plate")
    bench.vessel("trough/A1", 5_000_000, kind="trough", on="trough", capacity_nl=15_000_000)
    for well in ("A1", "B1"):
        bench.vessel(f"plate/{well}", kind="well", on="plate", capacity_nl=360_000)
    bench.vessel("other/A1", kind="well", on="other", capacity_nl=360_000)
    bench.device("robot", robot(), {"liquid_handler": "deck"})
    return bench


def moving(**args: object) -> dict[str, Any]:
    way = {"source_slot": "2", "source_well": "A1", "target_slot": "3", "target_well": "B1"}
    given = {**way, "volume_ul": 100.0, "rate_ul_s": 50.0, **args}
    return flow(step("t", "device_action", device="@deck", action="transfer_liquid", args=given))


def test_a_transfer_is_booked_from_well_to_well(bench: Bench) -> None:
    plan = plan_of(bench, moving())
    (job,) = plan.jobs
    assert actions(plan) == ["transfer_liquid"]
    assert job.operation == TransferLiquid(
        source_id=id_of("trough/A1"), target_id=id_of("plate/B1"), amount_nl=100_000
    )
    assert {id_of("trough/A1"), id_of("plate/B1"), id_of("deck")} <= set(job.locks)
    assert job.recovery == "R0"


@pytest.mark.parametrize(
    ("args", "code"),
    [
        ({"target_slot": "4"}, "plan.no_well"),
        ({"target_well": "H12"}, "plan.no_well"),
        ({"source_slot": "plate"}, "plan.no_well"),
        ({"volume_ul": 100.0001}, "plan.off_grid"),
        ({"volume_ul": 2000.0}, "driver.argument_range"),
        ({"volume_ul": 400.0}, "crutd.capacity_exceeded"),
    ],
)
def test_what_cannot_be_booked_is_refused(bench: Bench, args: dict[str, Any], code: str) -> None:
    assert codes_of(bench, moving(**args)) == [("t", code)]


def test_an_empty_well_gives_nothing(bench: Bench) -> None:
    way = {"source_slot": "3", "source_well": "A1"}
    assert codes_of(bench, moving(**way)) == [("t", "crutd.insufficient_volume")]


def test_what_is_drawn_or_given_alone_is_still_refused(bench: Bench) -> None:
    args = {"slot": "2", "well": "A1", "volume_ul": 50.0, "rate_ul_s": 50.0}
    value = flow(step("t", "device_action", device="@deck", action="aspirate", args=args))
    assert codes_of(bench, value) == [("t", "plan.moves_liquid")]


def test_its_other_actions_are_called_as_the_driver_declares_them(bench: Bench) -> None:
    value = flow(
        step("i", "device_action", device="@deck", action="initialize", args={}),
        step("p", "device_action", device="@deck", action="pick_up_tip", args=TIP),
        step("d", "device_action", device="@deck", action="drop_tip", args={}),
        edges=("i>p", "p>d"),
    )
    assert actions(plan_of(bench, value)) == ["initialize", "pick_up_tip", "drop_tip"]
