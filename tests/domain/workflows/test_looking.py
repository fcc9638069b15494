"""Cameras as witnesses: a step that looks, and a carry that is guarded and confirmed."""

from __future__ import annotations

from labweb.domain.crutd.operations import TransferResource
from labweb.domain.enrollment.driver_spec import ParameterSpec
from tests.domain.workflows.asking import codes_of, plan_of, the_job
from tests.domain.workflows.bench import (
    Bench,
    _action,
    _spec,
    a_bench,
    device_id_of,
    flow,
    id_of,
    step,
)

CAMERA = _spec("Eye", (_action("look", "camera", operation="read", recovery="R1"),), "sighting")
ARM = _spec(
    "Arm",
    (
        _action("run_program", "arm", ParameterSpec(name="program", type="string")),
        _action("stop_program", "arm", recovery="R1"),
    ),
    "is_running",
)
CARRY = {
    "resource": "@vial",
    "place": "@heater_1",
    "device": "@arm_1",
    "action": "run_program",
    "args": {"program": "fetch.urp"},
}
WITNESSED = {**CARRY, "tag": "V-7", "guard_with": "@eye_1", "confirm_with": "@eye_2"}


def a_cell() -> Bench:
    """Draw a vial on a shelf, an arm, a camera above the shelf and one above a free heater."""
    bench = a_bench()
    bench.stand("reactor", "lab")
    bench.add("shelf", "slot")
    bench.vessel("vial", on="shelf", kind="vial")
    bench.add("arm_1", "workstation")
    bench.device("arm_1", ARM, {"arm": "arm_1"})
    for key in ("eye_1", "eye_2"):
        bench.add(key, "transmitter")
        bench.device(key, CAMERA, {"camera": key})
    return bench


def test_a_carry_is_one_job_that_cameras_guard_and_confirm() -> None:
    job = the_job(plan_of(a_cell(), flow(step("c", "carry", **WITNESSED))), "run_program")
    assert job.args == {"program": "fetch.urp"}
    assert job.operation == TransferResource(
        resource_id=id_of("vial"), from_id=id_of("shelf"), to_id=id_of("heater_1")
    )
    ((guard,), (confirm,)) = job.pre, job.post
    assert (guard.device_id, guard.status, guard.equals) == (
        device_id_of("eye_1"), "sighting.tag", "V-7",
    )  # fmt: skip
    assert (confirm.device_id, confirm.name) == (device_id_of("eye_2"), "camera.tag")
    assert not confirm.may_stay_unconfirmed
    assert confirm.is_sensor
    assert confirm.timeout_s > 0


def test_without_a_tag_the_cameras_look_for_any_vessel_and_without_cameras_nobody_looks() -> None:
    bare = {**CARRY, "confirm_with": "@eye_2"}
    job = the_job(plan_of(a_cell(), flow(step("c", "carry", **bare))), "run_program")
    assert job.pre == ()
    assert (job.post[0].status, job.post[0].equals) == ("sighting.is_present", True)
    job = the_job(plan_of(a_cell(), flow(step("c", "carry", **CARRY))), "run_program")
    assert (job.pre, job.post) == ((), ())


def test_a_carry_may_say_that_what_its_camera_cannot_see_stays_unconfirmed() -> None:
    free = {**WITNESSED, "may_stay_unconfirmed": True}
    job = the_job(plan_of(a_cell(), flow(step("c", "carry", **free))), "run_program")
    assert [one.may_stay_unconfirmed for one in (*job.pre, *job.post)] == [False, True]
    value = flow(step("c", "carry", **CARRY, may_stay_unconfirmed=True))
    assert codes_of(a_cell(), value) == [("c", "plan.nothing_to_confirm")]


def test_what_is_no_camera_is_refused() -> None:
    wrong = {"guard_with": "@arm_1", "confirm_with": "@shelf"}
    value = flow(step("c", "carry", **{**WITNESSED, **wrong}))
    assert codes_of(a_cell(), value) == [("c", "plan.no_device"), ("c", "plan.no_device")]
    assert codes_of(a_cell(), flow(step("l", "look", camera="@arm_1"))) == [("l", "plan.no_device")]


def test_a_look_must_see_the_tag_or_else_an_empty_place() -> None:
    job = the_job(plan_of(a_cell(), flow(step("l", "look", camera="@eye_1", tag="V-7"))), "look")
    assert (job.post[0].status, job.post[0].equals) == ("sighting.tag", "V-7")
    job = the_job(plan_of(a_cell(), flow(step("l", "look", camera="@eye_1"))), "look")
    assert (job.post[0].status, job.post[0].equals) == ("sighting.is_present", False)
    assert not job.post[0].may_stay_unconfirmed
