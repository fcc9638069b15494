"""What stood around an action: kept with the job, in its provenance, and told to who may know."""

from __future__ import annotations

from typing import Any

from labweb.domain.runs.host_journal.surroundings import context_body
from labweb.records.selectors import provenance
from labweb.runs.models import Attempt, Job
from tests.builders import Bench, Edge, a_started_run, a_user, an_edge, to_transfer
from tests.labweb.records.test_provenance import API
from tests.labweb.web import read, signed_in


def told(bench: Bench, attempt: Attempt) -> dict[str, Any]:
    heater, pump = bench.device("heater_1"), attempt.job.device
    return context_body(
        pump.driver.digest,
        {"offset_ul": 0.5},
        [(str(heater.pk), "temperature_c", 21.5, 1.5), (str(pump.pk), "volume_ul", 0.0, 0.2)],
    )


def acted(bench: Bench, edge: Edge) -> Attempt:
    """Have the first transfer start and be answered, each in its context."""
    attempt = to_transfer(a_started_run(bench), edge)
    edge.report("accepted", attempt.id)
    edge.report("started", attempt.id, pid=4242, context=told(bench, attempt))
    edge.report(
        "actuated", attempt.id, report={"ok": True}, context={"driver_digest": ["no", "text"]}
    )
    edge.finish(attempt)
    return attempt


def test_a_job_keeps_the_context_of_its_start_and_nothing_that_is_none(bench: Bench) -> None:
    attempt = acted(bench, an_edge(bench))
    evidence = Job.objects.get(pk=attempt.job_id).evidence
    assert evidence["started_context"]["calibration"] == {"offset_ul": 0.5}
    assert "actuated_context" not in evidence


def test_the_provenance_tells_settings_and_surroundings_of_a_job(bench: Bench) -> None:
    attempt = acted(bench, an_edge(bench))
    target = attempt.job.operation["target_id"]
    resource = next(row for row in bench.lab.resources.all() if str(row.pk) == target)
    found = provenance.of_resource(resource, direction="up", depth=10)
    nodes = found.graph.nodes
    around = nodes[f"surroundings/{attempt.job_id}/started"]
    assert "21.5, 1.5 s old" in around.facts.values()
    settings = next(node for node in nodes.values() if node.type == "device_settings")
    assert settings.facts["calibration offset_ul"] == 0.5
    used = {r.earlier for r in found.graph.relations if r.later == f"job/{attempt.job_id}"}
    assert {around.id, settings.id} <= used


def test_readings_of_devices_that_one_may_not_know_of_are_not_told(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = acted(bench, edge)
    run = attempt.job.run_id
    whole = read(signed_in(bench.people["observer"]), f"{API}/runs/{run}/log")["lines"]
    started = [line["body"] for line in whole if (line["body"] or {}).get("context")]
    assert len(started[0]["context"]["environment"]) == 2
    one = read(signed_in(bench.people["observer"]), f"{API}/runs/{run}")
    job = next(job for job in one["jobs"] if job["id"] == str(attempt.job_id))
    assert job["evidence"]["started_context"]["environment"] == []
    guest = signed_in(a_user("observer", on=bench.node("pump_1"), name="guest"))
    graph = read(guest, f"{API}/resources/{bench.node('pump_1').pk}/provenance")
    assert "21.5, 1.5 s old" not in str(graph)
