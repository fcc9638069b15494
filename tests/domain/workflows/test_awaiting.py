"""A vessel becomes warm or cold by itself: its heater is read, and never switched."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.crutd.operations import Read
from labweb.domain.workflows.compile_workflow import check_plan, compile_workflow
from labweb.domain.workflows.plan_proof.prove_workflow import prove_plan
from tests.domain.workflows.station import station, workflow

WINDOW = {"vessel": "@reactor", "lowest": "18 °C", "highest": "25 °C"}


def waiting(**more: str | None) -> dict[str, Any]:
    params = {name: value for name, value in {**WINDOW, **more}.items() if value is not None}
    step = {"id": "s", "kind": "await_temperature", "params": params, "position": {"x": 0, "y": 0}}
    return {"schema": "labweb.workflow/1", "name": "One", "steps": [step], "edges": []}


def test_a_timer_ends_once_the_heater_reads_between_the_limits() -> None:
    document, lab = workflow(waiting()), station()
    plan = compile_workflow(document, lab)
    (job,) = plan.jobs
    assert (job.action, job.args) == ("wait", {"duration_s": 0.0})
    assert isinstance(job.operation, Read)
    (reached,) = job.post
    heater = next(one for one in lab.devices if one.id == reached.device_id)
    assert {"reach_temperature", "heat_to"} & {one.name for one in heater.spec.actions}
    assert (reached.status, reached.low, reached.high) == ("temperature_c", 18.0, 25.0)
    assert reached.timeout_s == 24 * 3600
    assert set(heater.nodes.values()) <= set(job.locks)
    assert prove_plan(document, plan, lab).findings == ()


@pytest.mark.parametrize(
    ("left_out", "low", "high", "told"),
    [("lowest", None, 25.0, "at 25 °C or below"), ("highest", 18.0, None, "at 18 °C or above")],
)
def test_one_limit_is_enough(
    left_out: str, low: float | None, high: float | None, told: str
) -> None:
    (job,) = compile_workflow(workflow(waiting(**{left_out: None})), station()).jobs
    (reached,) = job.post
    assert (reached.low, reached.high) == (low, high)
    assert told in job.sentence


@pytest.mark.parametrize(
    ("more", "code"),
    [
        ({"lowest": "26 °C"}, "plan.out_of_range"),
        ({"lowest": None, "highest": None}, "plan.no_limit"),
        ({"vessel": "@separator"}, "plan.no_device"),
        ({"vessel": "@crude"}, "plan.no_device"),
    ],
)
def test_a_window_that_nothing_can_be_in_is_refused(more: dict[str, str | None], code: str) -> None:
    assert {one.code for one in check_plan(workflow(waiting(**more)), station())} == {code}
