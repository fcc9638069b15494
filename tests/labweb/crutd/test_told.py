"""A person sees of each field of a resource whether it was set or measured, and since when."""

from __future__ import annotations

from typing import Any

from labweb.crutd import services
from labweb.crutd.models import Event
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.resources.models import Resource
from labweb.runs.models import Attempt
from tests.builders import Bench, a_started_run, an_edge, dispatched
from tests.labweb.web import signed_in


def told_of(bench: Bench, attempt: Attempt) -> dict[str, Any]:
    resource_id = attempt.job.operation["resource_id"]
    shown = signed_in(bench.people["chemist"]).get(f"/api/v1/resources/{resource_id}").json()
    found: dict[str, Any] = shown["data_told"]
    assert found.keys() <= shown["data"].keys()
    return found


def test_what_an_act_was_to_bring_about_is_set_and_what_it_reported_is_measured(
    bench: Bench,
) -> None:
    edge = an_edge(bench)
    attempt = dispatched(a_started_run(bench))
    assert attempt.job.operation["op"] == "update"
    asked = attempt.job.operation["data"]
    edge.act(attempt)
    read = Outcome(kind=OutcomeKind.DONE, data={"temperature_c": 21.7})
    edge.report("complete", attempt.id, **edge.settled(attempt, read))
    told = told_of(bench, attempt)
    at = Event.objects.latest("seq").at.isoformat(timespec="milliseconds")[:19]
    assert told["temperature_c"]["how"] == "measured"
    assert asked
    for name in asked:
        assert (told[name]["how"], told[name]["at"][:19]) == ("set", at)
        assert told[name]["job_id"] == str(attempt.job_id)


def test_what_a_run_did_to_a_resource_names_the_run(bench: Bench) -> None:
    edge = an_edge(bench)
    run = a_started_run(bench)
    attempt = dispatched(run)
    edge.complete(attempt)
    client = signed_in(bench.people["chemist"])
    path = f"/api/v1/resources/{attempt.job.operation['resource_id']}"
    for page in (client.get(path).json(), client.get(f"{path}/events").json()):
        assert page["events"][0]["run"] == {"id": str(run.pk), "number": run.number}


def test_what_a_halt_took_away_is_unknown_since(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = dispatched(a_started_run(bench))
    edge.complete(attempt)
    [name] = attempt.job.operation["data"]
    row = Resource.objects.get(pk=attempt.job.operation["resource_id"])
    services.note_halt(row, {name: None}, rev=row.rev + 1, code="edge.stopped", message="halted")
    assert told_of(bench, attempt)[name]["how"] == "unknown"
