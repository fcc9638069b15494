"""All that led to a thing and all that it touched, over the record of a lab.

```text
water ──▶ pump_1 ──▶ reactor_1, which stands in heater_1
```
"""

from __future__ import annotations

import io
import json
from datetime import timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import pytest
from django.core.management import CommandError, call_command
from django.db import connection
from django.test.utils import CaptureQueriesContext
from prov.model import ProvDocument

from labweb.approvals.models import Decision
from labweb.common.clock import now
from labweb.crutd import services as crutd_services
from labweb.crutd.models import Event, Transaction
from labweb.crutd.selectors import lineage
from labweb.domain.crutd import operations
from labweb.domain.crutd.provenance.prov_check import check_prov
from labweb.domain.crutd.provenance.prov_json_read import read_prov
from labweb.records.selectors import provenance
from labweb.resources.models import Lot
from labweb.runs import services
from labweb.runs.models import Job, Run
from labweb.telemetry.models import Sample
from tests.builders import HEAT, Bench, a_started_run, a_user, an_edge, to_transfer
from tests.labweb.web import call, code_of, read, signed_in

API = "/api/v1"


def done(bench: Bench, *workflows: str) -> list[Run]:
    """Carry workflows out one after the other; who is asked says yes."""
    edge = an_edge(bench)
    runs = []
    for workflow in workflows or ("Move 5 mL of water",):
        run = a_started_run(bench, workflow)
        for request in bench.lab.approvals.filter(state="open"):
            services.decide_request(
                request.id, actor=bench.people["approver"], is_approved=True, comment="seen"
            )
        edge.work_off(run)
        runs.append(Run.objects.get(pk=run.pk))
    return runs


def pour(bench: Bench, source: str, target: str, amount_nl: int) -> Transaction:
    operation = operations.TransferLiquid(
        source_id=bench.node(source).id, target_id=bench.node(target).id, amount_nl=amount_nl
    )
    return crutd_services.carry_out(operation, lab=bench.lab, actor_id=bench.people["chemist"].pk)


def carry(bench: Bench, key: str, place: str) -> Transaction:
    row = bench.unplug(key)
    assert row.parent_id is not None
    operation = operations.TransferResource(
        resource_id=row.id, from_id=row.parent_id, to_id=bench.node(place).id
    )
    return crutd_services.carry_out(operation, lab=bench.lab, actor_id=bench.people["chemist"].pk)


def names(found: provenance.Provenance, sort: str) -> set[str]:
    return {node.name for node in found.graph.nodes.values() if node.type == sort}


def test_a_product_leads_back_to_lot_run_person_device_and_driver(bench: Bench) -> None:
    done(bench)
    found = provenance.of_resource(bench.node("reactor_1"), direction="up", depth=10)
    assert names(found, "lot") == {"Water W-0001"}
    assert names(found, "run") == {"Run #1"}
    assert names(found, "workflow_version") == {"Move 5 mL of water v1"}
    assert names(found, "user") == {"Chemist Person"}
    assert "Pump 1" in names(found, "device")
    assert names(found, "driver_version") == {
        "drivers.connectors.tricontinent_c3000:TricontinentC3000"
    }
    assert not found.truncation()["is_truncated"]


def test_who_answered_a_doubt_belongs_to_what_came_of_it(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    edge.lose(attempt)
    approver = bench.people["approver"]
    services.resolve_job(
        attempt.job_id, actor=bench.people["chemist"], answer="happened", moved_nl=None, note="saw"
    )
    edge.resolve(attempt)
    told = Job.objects.get(pk=attempt.job_id).evidence["resolution"]
    assert (told["by"], told["by_id"]) == ("Chemist Person", str(bench.people["chemist"].pk))
    answer = signed_in(approver).get(f"{API}/resources/{bench.node('pump_1').id}/provenance")
    assert answer.status_code == 200
    assert "Chemist Person" in answer.content.decode()


def test_the_driver_is_the_one_that_the_command_named_and_not_the_present_one(
    bench: Bench,
) -> None:
    done(bench)
    device = bench.device("pump_1")
    before = device.driver.digest
    device.driver = bench.device("balance_1").driver
    device.save(update_fields=["driver"])
    found = provenance.of_resource(bench.node("reactor_1"), direction="up", depth=10)
    digests = {n.id for n in found.graph.nodes.values() if n.type == "driver_version"}
    assert digests == {f"driver/{before}"}


def test_what_was_done_to_the_vessel_meanwhile_belongs_to_it(bench: Bench) -> None:
    """The reactor was heated in heater_1 after it was filled; both led to what it holds."""
    done(bench, "Move 5 mL of water", HEAT)
    found = provenance.of_resource(bench.node("reactor_1"), direction="up", depth=10)
    assert names(found, "run") == {"Run #1", "Run #2"}
    assert "Bring Reactor 1 to 60 °C" in names(found, "job")
    assert names(found, "decision") == {Decision.objects.get().meaning}
    assert names(found, "user") == {"Chemist Person", "Approver Person"}


def test_what_was_done_to_a_vessel_before_it_was_filled_does_not(bench: Bench) -> None:
    done(bench, HEAT)
    pour(bench, "water", "reactor_1", 5_000_000)
    poured = Event.objects.order_by("-seq")[0].seq
    carry(bench, "reactor_1", "bench_1")
    pour(bench, "reactor_1", "flask_1", 1_000_000)
    found = provenance.of_resource(bench.node("flask_1"), direction="up", depth=10)
    assert names(found, "run") == set()
    acts = [n.facts["event_seq"] for n in found.graph.nodes.values() if n.type == "transaction"]
    last = Event.objects.order_by("-seq")[0].seq
    assert sorted(acts) == [1, poured, last - 1, last]


def test_all_that_was_made_from_a_lot(bench: Bench) -> None:
    done(bench)
    pour(bench, "reactor_1", "flask_1", 1_000_000)
    pour(bench, "acid", "flask_2", 1_000)
    lot = Lot.objects.get(key="water_lot")
    found = provenance.of_lot(lot, direction="down", depth=10)
    assert names(found, "resource") >= {"Water", "Reactor 1", "Flask 1"}
    assert "Flask 2" not in names(found, "resource")
    up = provenance.of_lot(lot, direction="up", depth=10)
    assert names(up, "resource") & {"Reactor 1", "Flask 1"} == set()


def test_a_run_has_what_it_used_and_what_became_of_it(bench: Bench) -> None:
    pour(bench, "acid", "water", 1_000_000)
    run = done(bench)[0]
    pour(bench, "reactor_1", "flask_1", 1_000_000)
    up = provenance.of_run(run, direction="up", depth=10)
    down = provenance.of_run(run, direction="down", depth=10)
    assert len(names(up, "lot")) == 2
    assert "Flask 1" in names(down, "resource") - names(up, "resource")
    for found in (up, down):
        assert len({n for n in found.graph.nodes if n.startswith("job/")}) == run.jobs.count()


def test_a_walk_is_cut_at_its_depth_and_says_so(bench: Bench) -> None:
    vessels = ["water", "flask_1", "flask_2", "reactor_1"]
    for amount, (source, target) in enumerate(pairwise(vessels)):
        pour(bench, source, target, 3_000_000 - amount * 500_000)
    found = provenance.of_resource(bench.node("reactor_1"), direction="up", depth=2)
    assert found.truncation()["beyond"] == 1
    assert "Water" not in names(found, "resource")


def test_a_vessel_with_too_long_a_history_is_named(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for _ in range(4):
        pour(bench, "water", "flask_1", 1_000_000)
    pour(bench, "flask_1", "flask_2", 1_000_000)
    monkeypatch.setattr(lineage, "_MOST_ENTRIES", 3)
    found = provenance.of_resource(bench.node("flask_2"), direction="up", depth=5)
    assert found.truncation() == {
        "is_truncated": True,
        "beyond": 0,
        "unread": [str(bench.node("flask_1").id)],
        "has_more_acts": False,
    }


def test_more_history_costs_no_more_queries(bench: Bench) -> None:
    def cost() -> int:
        with CaptureQueriesContext(connection) as queries:
            provenance.of_resource(bench.node("reactor_1"), direction="up", depth=10)
        return len(queries)

    done(bench)
    before = cost()
    for _ in range(5):
        pour(bench, "water", "reactor_1", 1_000)
        pour(bench, "acid", "reactor_1", 1_000)
    assert cost() <= before


def test_the_prov_document_of_a_run_comes_back_equal_and_is_consistent(bench: Bench) -> None:
    runs = done(bench, "Move 5 mL of water", HEAT)
    client = signed_in(bench.people["observer"])
    for path in (
        f"resources/{bench.node('reactor_1').id}",
        f"runs/{runs[1].id}",
        f"lots/{Lot.objects.get(key='water_lot').id}",
    ):
        document = read(client, f"{API}/{path}/provenance?form=prov")
        raw = json.dumps(document)
        first = ProvDocument.deserialize(content=raw, format="json")
        again = ProvDocument.deserialize(content=first.serialize(format="json"), format="json")
        assert first == again
        assert len(list(first.get_records())) > 20
        assert check_prov(read_prov(raw.encode())) == []


@pytest.mark.parametrize(
    "query", ["direction=sideways", "depth=0", "depth=101", "depth=x", "form=xml"]
)
def test_what_is_not_offered_is_refused(bench: Bench, query: str) -> None:
    client = signed_in(bench.people["observer"])
    path = f"{API}/resources/{bench.node('water').id}/provenance?{query}"
    assert read(client, path, status=422)["code"] == "http.query"


def test_what_is_not_there_is_not_found(bench: Bench) -> None:
    client = signed_in(bench.people["observer"])
    for sort, code in (
        ("resources", "resource.not_found"),
        ("lots", "lot.not_found"),
        ("runs", "run.not_found"),
    ):
        assert read(client, f"{API}/{sort}/{uuid4()}/provenance", status=404)["code"] == code


def test_a_guest_gets_the_form_of_what_is_outside_and_none_of_its_words(bench: Bench) -> None:
    """The guest's subtree is balance_1 with flask_1."""
    done(bench, "Move 5 mL of water", HEAT)
    pour(bench, "reactor_1", "flask_1", 1_000_000)
    guest = signed_in(a_user("chemist", on=bench.node("balance_1"), name="guest"))
    flask = f"{API}/resources/{bench.node('flask_1').id}"
    whole = read(signed_in(bench.people["admin"]), f"{flask}/provenance")
    told = read(guest, f"{flask}/provenance")
    assert {n["id"] for n in told["nodes"]} == {n["id"] for n in whole["nodes"]}
    named = {n["name"] for n in told["nodes"]}
    assert {"Flask 1", "elsewhere", "Water W-0001"} <= named
    text = json.dumps([[n["name"], n["facts"]] for n in told["nodes"]], ensure_ascii=False)
    known = json.dumps([[n["name"], n["facts"]] for n in whole["nodes"]], ensure_ascii=False)
    for word in ("Reactor", "Pump", "Run #", "Approver", "60 °C"):
        assert word not in text, word
        assert word in known, word
    prov = read(guest, f"{flask}/provenance?form=prov")
    assert "Reactor" not in json.dumps(prov)


def test_conditions_are_what_the_device_told_while_the_thing_was_in_it(bench: Bench) -> None:
    heater = bench.device("heater_1")
    start = now()
    out = carry(bench, "reactor_1", "bench_1")
    back = carry(bench, "reactor_1", "heater_1")
    assert out.settled_at is not None
    assert back.settled_at is not None
    middle = out.settled_at + (back.settled_at - out.settled_at) / 2
    for number, at in enumerate((start, middle, now() + timedelta(seconds=1))):
        Sample.objects.create(
            device=heater, status="temperature_c", at=at.timestamp(), value=20.0 + number
        )
    client = signed_in(bench.people["observer"])
    path = f"{API}/resources/{bench.node('reactor_1').id}/conditions?device={heater.id}"
    until = now().timestamp() + 60
    told = read(client, f"{path}&since_s={start.timestamp() - 60}&until_s={until}")
    values = [[v for _, v in stay["series"]["temperature_c"]] for stay in told["stays"]]
    assert values == [[20.0], [22.0]]
    flask = bench.node("flask_2").id
    none = read(client, f"{API}/resources/{flask}/conditions?device={heater.id}")
    assert none["stays"] == []


def test_conditions_name_the_acts_of_the_device_with_driver_and_reading(bench: Bench) -> None:
    done(bench, HEAT)
    heater = bench.device("heater_1")
    client = signed_in(bench.people["observer"])
    path = f"{API}/resources/{bench.node('reactor_1').id}/conditions?device={heater.id}"
    acts = read(client, path)["stays"][0]["acts"]
    assert "Bring Reactor 1 to 60 °C" in {act["sentence"] for act in acts}
    assert {act["driver_digest"] for act in acts} == {heater.driver.digest}
    guest = signed_in(a_user("chemist", on=bench.node("heater_1"), name="guest"))
    assert [stay["acts"] for stay in read(guest, path)["stays"]] != []


def test_conditions_in_a_device_that_may_not_be_known_are_not_told(bench: Bench) -> None:
    guest = signed_in(a_user("chemist", on=bench.node("balance_1"), name="guest"))
    flask = bench.node("flask_1").id
    for device, status in ((bench.device("heater_1").id, 404), ("x", 422), ("", 422)):
        answer = call(guest, "GET", f"{API}/resources/{flask}/conditions?device={device}")
        assert answer.status_code == status
    answer = call(guest, "GET", f"{API}/resources/{flask}/conditions")
    assert code_of(answer) == "http.query"


def told(*args: str) -> str:
    out = io.StringIO()
    call_command("provenance", *args, stdout=out, stderr=io.StringIO())
    return out.getvalue()


def test_the_command_takes_keys_numbers_and_ids(bench: Bench) -> None:
    run = done(bench)[0]
    by_key = told("reactor_1", "--direction", "up")
    assert told(str(bench.node("reactor_1").id), "--direction", "up") == by_key
    assert "Aspirate 5.00 mL from Water" in by_key
    assert told("#1") == told("run:1") == told(str(run.id))
    assert "Reactor 1" in told("lot:water_lot", "--direction", "down")


def test_the_command_prints_json_prov_and_dot(bench: Bench) -> None:
    done(bench)
    plain: dict[str, Any] = json.loads(told("reactor_1", "--format", "json"))
    assert UUID(plain["root"].removeprefix("resource/")) == bench.node("reactor_1").id
    assert "prefix" in json.loads(told("reactor_1", "--format", "prov"))
    assert told("reactor_1", "--format", "dot").startswith("digraph provenance {")


@pytest.mark.parametrize("args", [["nothing"], ["reactor_1", "--depth", "0"], ["lot:reactor_1"]])
def test_the_command_refuses_what_it_cannot_tell(bench: Bench, args: list[str]) -> None:
    with pytest.raises(CommandError):
        told(*args)


def test_the_command_judges_documents(bench: Bench, tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text(told("reactor_1", "--format", "prov"))
    assert told("--check", str(file)) == "a.json: valid\n"
    file.write_text('{"entity": {"no:a": {}}}')
    with pytest.raises(CommandError, match=r"prov.malformed: .* at entity/no:a"):
        told("--check", str(file))
    file.write_text(
        '{"prefix": {"e": "http://e/"}, "entity": {"e:a": {}}, "activity": {"e:a": {}}}'
    )
    with pytest.raises(CommandError, match="contradicts itself"):
        told("--check", str(file))
