"""A plan acts through what a device brought into the tree, as through what people drew."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import inspect_file
from labweb.domain.crutd.operations import Dispose, TransferLiquid
from labweb.domain.graph.device_parts import injected
from labweb.domain.graph.device_parts_by_role import SORTS
from labweb.domain.workflows.passes.role_requirements import beyond_limits
from labweb.domain.workflows.unit_operations.step_palette import CARRIED_KINDS
from tests.domain.workflows.asking import actions, codes_of, findings_of, plan_of
from tests.domain.workflows.bench import Bench, flow, id_of, step


def a_lab(path: str, **config: object) -> Bench:
    """Return a lab with one device and all that it brings, and a timer."""
    bench, spec = Bench(), inspect_file(PACKAGE / path)
    made = injected(spec, config, key="device", name="Device")
    for part in made.parts:
        capacity_ul = part.config.get("capacity_ul")
        state = {} if capacity_ul is None else {"capacity_nl": round(capacity_ul * 1000)}
        bench.add(part.key, part.kind, on=part.inside or "lab", config=part.config, **state)
    bench.device("device", spec, made.nodes, **config)
    timer = inspect_file(PACKAGE / "virtual" / "timer.py")
    bench.add("timer", "timer")
    bench.device("timer", timer, {"timer": "timer"})
    return bench


def called(action: str, args: Mapping[str, Any], **params: str) -> dict[str, Any]:
    return flow(step("s", "device_action", device="@device", action=action, args=args, **params))


def test_a_plate_in_the_clamps_of_a_shaker_is_heated_by_it() -> None:
    bench = a_lab("processing/bioshake.py", max_temperature_c=60.0)
    bench.add("plate", "plate", on="device_plate")
    bench.vessel("plate/A1", 100_000, kind="well", on="plate", capacity_nl=360_000)
    heated = flow(step("h", "heat_chill", vessel="@plate/A1", temperature="50 °C"))
    assert actions(plan_of(bench, heated)) == ["reach_temperature"]
    hot = flow(step("h", "heat_chill", vessel="@plate/A1", temperature="70 °C"))
    assert codes_of(bench, hot) == [("h", "plan.out_of_range")]


def test_what_the_settings_of_a_device_forbid_is_refused_before_a_start() -> None:
    bench = a_lab("processing/julabo_cf41.py", max_temperature_c=110.0)
    asked = {"temperature_c": 130.0, "tolerance_c": 1.0}
    (found,) = findings_of(bench, called("reach_temperature", asked))
    assert (found.code, found.context["high"]) == ("plan.out_of_range", 110.0)
    assert "-40 to 110 °C; asked for 130 °C" in found.message
    larger = a_lab("processing/julabo_cf41.py", max_temperature_c=200.0)
    assert actions(plan_of(larger, called("reach_temperature", asked))) == ["reach_temperature"]


def test_no_steepest_ramp_bounds_none_and_what_is_no_number_bounds_nothing() -> None:
    furnace = {"max_temperature_c": 1000.0, "max_ramp_k_min": 0.0}
    bench = a_lab("processing/s7_furnace.py", **furnace)
    ramp = {"temperature_c": 400.0, "ramp_k_min": 5.0, "tolerance_c": 5.0}
    assert actions(plan_of(bench, called("ramp_to", ramp))) == ["ramp_to"]
    bench = Bench()
    bench.add("it", "foreign", config={"max_temperature_c": "50", "min_temperature_c": True})
    julabo = inspect_file(PACKAGE / "processing/julabo_cf41.py")
    bench.device("device", julabo, {"thermostat": "it"})
    view = bench.view()
    asked = {"temperature_c": 90.0, "tolerance_c": 1.0}
    assert beyond_limits(view.devices[0], "reach_temperature", asked, view.tree) == []


def test_a_robot_moves_liquid_between_plates_in_the_slots_that_it_brought() -> None:
    bench = a_lab("processing/opentrons_ot2.py", deck={"2": "a/b/1", "11": "a/b/1"})
    for slot, key in (("2", "here"), ("11", "there")):
        bench.add(key, "plate", on=f"device_deck/{slot}")
        bench.vessel(f"{key}/A1", 200_000, kind="well", on=key, capacity_nl=360_000)
    way = {"source_slot": "2", "source_well": "A1", "target_slot": "11", "target_well": "A1"}
    plan = plan_of(bench, called("transfer_liquid", {**way, "volume_ul": 50.0, "rate_ul_s": 50.0}))
    assert plan.jobs[0].operation == TransferLiquid(
        source_id=id_of("here/A1"), target_id=id_of("there/A1"), amount_nl=50_000
    )


def test_an_analyser_draws_from_a_vial_in_its_tray() -> None:
    bench = a_lab("characterization/lab_hplc.py")
    bench.vessel("vial", 1_000_000, kind="vial", on="device_tray", capacity_nl=2_000_000)
    args = {"vial": "1", "method": "m", "injection_ul": 5.0, "sample": "s"}
    plan = plan_of(bench, called("measure", args, sample="@vial"))
    assert plan.jobs[0].operation == Dispose(resource_id=id_of("vial"), amount_nl=5_000)


def test_a_loop_is_filled_by_plan_once_somebody_has_said_how_much_it_takes() -> None:
    known, unknown = (
        a_lab("connectors/vici_injection.py", load_position="A", **told)
        for told in ({"loop_ul": 20.0}, {})
    )
    value = flow(step("t", "transfer", source="@dye", target="@device_loop", volume="10 µL"))
    for bench in (known, unknown):
        bench.vessel("dye", 50_000_000, kind="bottle")
        bench.pump(1, {1: ("dye", 0), 2: ("device_loop", 0)})
    assert "dispense" in actions(plan_of(known, value))
    assert codes_of(unknown, value) == [("t", "crutd.unknown_capacity")]


def test_what_is_a_part_of_a_device_is_not_carried() -> None:
    carried = {
        part.kind for sort in SORTS.values() for part in sort.places if part.kind in CARRIED_KINDS
    }
    assert carried == {"carrier"}, "a tray of vials comes out of its instrument"


def test_no_plan_moves_liquid_with_a_syringe_that_only_infuses() -> None:
    bench = a_lab("connectors/new_era_ne1000.py", syringe_ul=5000.0, diameter_mm=12.0)
    bench.vessel("dye", 50_000_000, kind="bottle")
    bench.vessel("flask")
    bench.tube("device:outlet", "dye:")
    bench.tube("device:outlet", "flask:")
    value = flow(step("t", "transfer", source="@dye", target="@flask", volume="1 mL"))
    assert codes_of(bench, value) == [("t", "plan.no_device")]
