"""The lab comes back from its events: the same tree, ledger and states, now and then."""

from __future__ import annotations

import json
from io import StringIO
from urllib.parse import quote
from uuid import UUID

import pytest
from django.core.management import CommandError, call_command

from labweb.common.clock import now
from labweb.crutd import services
from labweb.crutd.models import Holding
from labweb.crutd.selectors.history_replay import as_it_was, rebuild_differences, replayed
from labweb.domain.crutd import operations
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import ReconcileError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.resources.models import Resource
from labweb.runs import services as run_services
from tests.builders import Bench, a_started_run, a_user, an_edge, dispatched, to_transfer
from tests.labs import generated_lab
from tests.labweb.crutd.test_verify import tamper
from tests.labweb.web import read, signed_in


def move(bench: Bench, key: str, place: str) -> None:
    row = bench.unplug(key)
    assert row.parent_id is not None
    operation = operations.TransferResource(
        resource_id=row.id, from_id=row.parent_id, to_id=bench.node(place).id
    )
    services.carry_out(operation, lab=bench.lab, actor_id=bench.people["chemist"].pk)


def do(bench: Bench, operation: operations.Operation) -> None:
    services.carry_out(operation, lab=bench.lab, actor_id=bench.people["chemist"].pk)


def test_a_lab_that_was_only_imported_is_rebuilt(bench: Bench) -> None:
    assert rebuild_differences(bench.lab) == []
    assert len(replayed(bench.lab).nodes) == Resource.objects.count()


def test_a_lab_that_ran_and_was_worked_on_by_hand_is_rebuilt(bench: Bench) -> None:
    an_edge(bench).work_off(a_started_run(bench))
    move(bench, "flask_2", "lab")
    bench_1 = bench.node("bench_1")
    do(bench, operations.Update(resource_id=bench_1.id, data={"note": "clean"}))
    do(
        bench,
        operations.Create(
            resource_id=UUID(int=7, version=4), parent_id=bench_1.id,
            key="new", name="New", kind="vial", config={"capacity_ul": 5},
        ),
    )  # fmt: skip
    flask, archive = bench.unplug("flask_1"), bench.node("archive")
    do(bench, operations.Delete(resource_id=flask.id, archive_id=archive.id))
    assert rebuild_differences(bench.lab) == []


@pytest.mark.parametrize("answer", ["happened", "did_not", "partly", "discard"])
def test_a_doubt_and_each_answer_to_it_are_rebuilt(bench: Bench, answer: str) -> None:
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    edge.lose(attempt)
    assert rebuild_differences(bench.lab) == []
    assert any(node.quarantined_by for node in replayed(bench.lab).nodes.values())
    run_services.resolve_job(
        attempt.job_id,
        actor=bench.people["chemist"],
        answer=answer,
        moved_nl=1_000_000 if answer == "partly" else None,
        note="I looked",
    )
    edge.resolve(attempt)
    assert rebuild_differences(bench.lab) == []
    still = any(node.quarantined_by for node in replayed(bench.lab).nodes.values())
    assert still is (answer == "discard")


def test_what_a_device_was_to_be_set_to_is_unknown_once_nobody_can_tell(bench: Bench) -> None:
    edge, run = an_edge(bench), a_started_run(bench)
    attempt = dispatched(run)
    seen: set[str] = set()
    while (asked := attempt.job.operation)["op"] != "update" or asked["resource_id"] not in seen:
        seen |= {asked["resource_id"]} if asked["op"] == "update" else set()
        edge.complete(attempt)
        attempt = dispatched(run)
    before = Resource.objects.get(pk=asked["resource_id"]).data
    assert all(before[name] is not None for name in asked["data"])
    edge.lose(attempt)
    run_services.resolve_job(
        attempt.job_id, actor=bench.people["chemist"], answer="discard", moved_nl=None, note="?"
    )
    edge.resolve(attempt)
    unknown = dict.fromkeys(asked["data"])
    assert Resource.objects.get(pk=asked["resource_id"]).data == {**before, **unknown}
    assert rebuild_differences(bench.lab) == []


def test_a_difference_between_edge_and_server_is_rebuilt(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    edge.act(attempt)
    body = edge.settled(attempt, Outcome(kind=OutcomeKind.DONE))
    body["change"]["postings"][0]["amount_nl"] -= 1
    edge.report("complete", attempt.id, **body)
    assert Resource.objects.filter(quarantined_by=attempt.transaction_id).count() == 2
    assert rebuild_differences(bench.lab) == []


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.django_db
def test_a_generated_lab_is_rebuilt_from_its_import(seed: int) -> None:
    lab = services.import_lab(read_lab(generated_lab(seed)), actor=None, source={})
    assert rebuild_differences(lab) == []


@pytest.mark.parametrize(
    ("sql", "code"),
    [
        ("UPDATE resources_resource SET name = 'Other' WHERE key = 'water'", "rebuild.tree"),
        ("UPDATE resources_resource SET rev = rev + 1 WHERE key = 'water'", "rebuild.tree"),
        ("UPDATE resources_resource SET data = '{\"x\": 1}' WHERE key = 'water'", "rebuild.tree"),
        ("UPDATE resources_resource SET is_archived = true WHERE key = 'water'", "rebuild.tree"),
        ("UPDATE crutd_holding SET amount_nl = amount_nl + 1", "rebuild.ledger"),
        ("UPDATE crutd_entry SET amount_nl = 1 WHERE debit = 'RECEIPT'", "rebuild.ledger"),
        ("UPDATE crutd_transaction SET state = 'rolled_back'", "rebuild.state"),
    ],
)
def test_a_row_that_was_tampered_with_differs_from_the_events(
    bench: Bench, sql: str, code: str
) -> None:
    tamper(sql)
    assert {finding.code for finding in rebuild_differences(bench.lab)} == {code}


def test_an_unreadable_event_is_named(bench: Bench) -> None:
    tamper("UPDATE crutd_event SET body = '{}'")
    with pytest.raises(ReconcileError, match="event 1") as refusal:
        rebuild_differences(bench.lab)
    assert refusal.value.code == "rebuild.unreadable"


def test_the_command_compares_and_fails(bench: Bench) -> None:
    out = StringIO()
    call_command("rebuild", "--check", stdout=out)
    assert out.getvalue() == f"{bench.lab.key}: equal\n"
    tamper("DELETE FROM crutd_labbase WHERE lab_id = %s", bench.lab.id)
    out = StringIO()
    with pytest.raises(CommandError) as failure:
        call_command("rebuild", "--check", "--json", stdout=out)
    assert failure.value.returncode == 1
    assert json.loads(out.getvalue())["labs"][bench.lab.key][0]["code"] == "rebuild.no_base"


def test_every_moment_can_be_shown_again(bench: Bench) -> None:
    def state() -> dict[str, object]:
        rows = Resource.objects.filter(lab=bench.lab)
        held = Holding.objects.filter(amount_nl__gt=0)
        return {
            "parents": {row.id: row.parent_id for row in rows},
            "held": {(h.resource_id, str(h.lot_id)): h.amount_nl for h in held},
            "closed": {row.id for row in rows if row.quarantined_by},
        }

    edge = an_edge(bench)
    moments = [(now(), state())]
    move(bench, "flask_2", "lab")
    moments.append((now(), state()))
    attempt = to_transfer(a_started_run(bench), edge)
    moments.append((now(), state()))
    edge.lose(attempt)
    moments.append((now(), state()))
    for at, was in moments:
        past = as_it_was(bench.lab, at, now=now())
        told = {
            "parents": {row.id: row.parent_id for row in past.rows},
            "held": {
                (vessel, lot): amount.nl
                for vessel, lots in past.contents.items()
                for lot, amount in lots.items()
            },
            "closed": {row.id for row in past.rows if row.quarantined_by},
        }
        assert told == was
    assert moments[0][1] != moments[3][1]


def test_the_api_shows_the_lab_as_it_was(bench: Bench) -> None:
    client = signed_in(bench.people["observer"])
    before, at = read(client, "/api/v1/resources"), now()
    move(bench, "flask_2", "lab")
    an_edge(bench).work_off(a_started_run(bench))
    after = read(client, "/api/v1/resources")
    was = read(client, f"/api/v1/resources?at={quote(at.isoformat())}")
    assert was["resources"] == before["resources"] != after["resources"]
    assert (
        read(client, f"/api/v1/resources?at={quote(now().isoformat())}")["resources"]
        == (after["resources"])
    )


@pytest.mark.parametrize(
    ("at", "code"),
    [
        ("2020-01-01T00:00:00Z", "time.before_lab"),
        ("2999-01-01T00:00:00Z", "time.future"),
        ("2026-01-01T00:00:00", "http.query"),
        ("yesterday", "http.query"),
        ("", "http.query"),
    ],
)
def test_a_time_at_which_there_is_nothing_to_show_is_refused(
    bench: Bench, at: str, code: str
) -> None:
    answer = signed_in(bench.people["observer"]).get(f"/api/v1/resources?at={at}")
    assert (answer.status_code, answer.json()["code"]) == (422, code)


def test_who_sees_a_part_of_the_lab_sees_that_part_of_its_past(bench: Bench) -> None:
    guest = signed_in(a_user("observer", on=bench.node("flask_1"), name="guest"))
    path = f"/api/v1/resources?at={quote(now().isoformat())}"
    assert [row["key"] for row in read(guest, path)["resources"]] == ["flask_1"]
