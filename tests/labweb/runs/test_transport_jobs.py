"""A job that carries a rack from one host's place to another's, by the arm of a third.

bench_1 (Host 1) ── arm (host of the arm) ──▶ bench_9 (bench 9)
"""

from __future__ import annotations

from typing import Any
from uuid import uuid4

import pytest

from labweb.crutd.models import Ticket
from labweb.domain.errors import Effect
from labweb.domain.resources.resource_kinds import KINDS
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import EdgeHost
from labweb.fleet.services import host_absence
from labweb.resources.models import Connection, Resource
from labweb.runs import services
from labweb.runs.models import Custody, Outbox, Run
from labweb.workflows.models import WorkflowVersion
from tests.builders import MOVE_WATER, Bench, Edge, catalog, host_key, public_half
from tests.labweb.runs.hosts import Host, live_locks, states
from tests.labweb.web import signed_in

ARM = "drivers.logistics.ur_dashboard:UrDashboard"
CARRY: dict[str, Any] = {
    "resource": "rack",
    "place": "bench_9",
    "device": "arm",
    "action": "run_program",
    "args": {"program": "rack.urp"},
}


class Other(Edge):
    """The messages of another host."""

    def __init__(self, bench: Bench, key: str) -> None:
        super().__init__(bench)
        self.host_id = EdgeHost.objects.get(key=key).id


def a_node(bench: Bench, key: str, kind: str, on: str = "lab", **fields: Any) -> Resource:  # noqa: ANN401
    plain = {"id": uuid4(), "lab": bench.lab, "key": key, "name": key, "kind": kind}
    plain["nature"] = KINDS[kind].nature.value
    return Resource.objects.create(parent=bench.node(on), **plain | fields)


def a_host(bench: Bench, key: str, node: Resource, driver: str = ARM) -> None:
    """Add a host with one device, which has the node."""
    public = public_half(host_key())
    made = enrollment_services.add_host(
        bench.lab, key=key, name=key, host_id=uuid4(), public_key=public
    )
    enrollment_services.found_device(
        bench.lab,
        uuid4(),
        driver=enrollment_services.keep_driver(catalog()[driver]),
        key=f"device of {key}",
        name=f"device of {key}",
        host_id=made.id,
        transport=f"virtual:{key}",
        config={"programs": ["rack.urp"]},
        nodes={"arm": str(node.id)},
        state="enrolled",
    )


@pytest.fixture
def hosts(bench: Bench) -> dict[str, Host]:
    rack = a_node(bench, "rack", "tube_rack", "bench_1")
    a_node(bench, "tube", "tube", "rack", config={"capacity_ul": 1000})
    a_host(bench, "bench 9", a_node(bench, "bench_9", "bench"))
    a_host(bench, "arm host", a_node(bench, "arm", "workstation"))
    pump = bench.device("pump_1")
    pump.nodes = {**pump.nodes, "rack": str(rack.id)}
    pump.save()
    return {
        "A": Host(bench),
        "B": Host(bench, Other(bench, "bench 9")),
        "arm": Host(bench, Other(bench, "arm host")),
    }


def a_run(bench: Bench, *steps: dict[str, Any], **document: object) -> Run:
    made = [
        {
            "id": f"s{number}",
            "kind": "carry",
            "params": {
                name: str(bench.node(value).id)
                if name in {"resource", "place", "device"} and isinstance(value, str)
                else value
                for name, value in params.items()
            },
        }
        for number, params in enumerate(steps)
    ]
    ends = {"source_port": "done", "target_port": "start"}
    edges = [
        {"id": f"e{number}", "source": f"s{number}", "target": f"s{number + 1}", **ends}
        for number in range(len(steps) - 1)
    ]
    version = bench.version(MOVE_WATER)
    plain = {"schema": version.document["schema"], "name": "Carry", "steps": made, "edges": edges}
    row = WorkflowVersion.objects.create(
        id=uuid4(),
        workflow=version.workflow,
        number=99,
        document={**plain, **document},
        author=version.author,
        at=version.at,
        digest=version.digest,
    )
    return services.start_run(row, actor=bench.people["chemist"])


def hear(host: Host) -> None:
    """Have a host take what it is sent, and tell what became of it."""
    host.take()
    host.tell()


def holders(hosts: dict[str, Host], resource: Resource) -> set[str]:
    return {name for name, host in hosts.items() if resource.id in host.disk.resources}


def check_hands(bench: Bench, hosts: dict[str, Host]) -> None:
    """I11: a rack and its tube are in one pair of hands, or in transit, never in two."""
    rack, tube = holders(hosts, bench.node("rack")), holders(hosts, bench.node("tube"))
    assert len(rack) <= 1
    assert len(tube) <= 1
    assert tube <= rack or not rack


def to_the_arm(hosts: dict[str, Host]) -> None:
    assert services.dispatch_ready() == 0, "its host has it and is asked first"
    hear(hosts["A"])
    hear(hosts["arm"])
    assert services.dispatch_ready() == 1


def log(bench: Bench, run: Run) -> list[str]:
    answer = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{run.id}/log")
    return [line["kind"] for line in answer.json()["lines"]]


def test_a_rack_goes_from_hand_to_hand_with_what_is_in_it(
    bench: Bench, hosts: dict[str, Host]
) -> None:
    run, rack = a_run(bench, CARRY), bench.node("rack")
    assert services.dispatch_ready() == 0
    made = Custody.objects.get()
    assert (made.state, str(made.job.run_id if made.job else "")) == ("leaving", str(run.id))
    assert states(run) == ["queued"]
    assert services.dispatch_ready() == 0, "it is asked for once"
    hear(hosts["A"])
    assert Custody.objects.get().state == "in_transit"
    assert holders(hosts, rack) == set()
    hear(hosts["arm"])
    assert holders(hosts, rack) == holders(hosts, bench.node("tube")) == {"arm"}
    assert services.dispatch_ready() == 1
    hosts["arm"].take()
    assert hosts["arm"].step()
    hosts["arm"].tell()
    assert states(run) == ["complete"]
    assert bench.node("rack").parent_id == bench.node("bench_9").id
    hear(hosts["arm"])
    assert holders(hosts, rack) == set()
    hear(hosts["B"])
    assert holders(hosts, rack) == holders(hosts, bench.node("tube")) == {"B"}
    assert hosts["B"].disk.resources[rack.id].view.parent_id == bench.node("bench_9").id
    assert [move.owner and move.owner.key for move in Custody.objects.order_by("at")] == [
        "arm host",
        "bench 9",
    ]
    assert live_locks() == 0
    assert not Outbox.objects.filter(settled_at__isnull=True).exists()
    assert [kind for kind in log(bench, run) if kind in {"asked", "released", "received"}] == [
        "asked",
        "released",
        "received",
    ] * 2
    found = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{run.id}/events").json()
    said = [event["summary"] for event in found["events"]]
    assert said.count("rack: handed to another host at bench_9") == 1
    assert "rack: Bench 1 → bench_9" in said


@pytest.mark.parametrize("dies", ["A", "arm", "B"])
def test_any_host_may_reconnect_between_any_two_steps(
    bench: Bench, hosts: dict[str, Host], dies: str
) -> None:
    run = a_run(bench, CARRY)
    for _ in range(12):
        services.dispatch_ready()
        hosts[dies].reconnect()
        for host in hosts.values():
            host.take()
            host.take()
            host.step()
            check_hands(bench, hosts)
        hosts[dies].reconnect()
        for host in hosts.values():
            host.tell()
    assert states(run) == ["complete"]
    assert run.jobs.get().attempts.count() == 1
    assert holders(hosts, bench.node("rack")) == {"B"}
    assert live_locks() == 0


def test_a_rack_is_carried_there_and_back(bench: Bench, hosts: dict[str, Host]) -> None:
    run = a_run(bench, CARRY, {**CARRY, "place": "bench_1"}, execution={
        "on_disconnect": "continue", "max_offline_s": 60
    })  # fmt: skip
    for _ in range(20):
        services.dispatch_ready()
        for host in hosts.values():
            host.take()
            host.step()
            check_hands(bench, hosts)
            host.tell()
    assert states(run) == ["complete", "complete"]
    assert not Outbox.objects.filter(kind="batch").exists(), "other hosts have a say"
    assert bench.node("rack").parent_id == bench.node("bench_1").id
    assert holders(hosts, bench.node("rack")) == {"arm"}, "bench 1 belongs to no device"


def test_a_host_that_keeps_it_holds_the_job(bench: Bench, hosts: dict[str, Host]) -> None:
    run, made = a_run(bench, CARRY), None
    services.dispatch_ready()
    made = Custody.objects.get()
    body = {"transfer_id": str(made.transfer_id), "resource_id": str(made.resource_id)}
    hosts["A"].edge.report("kept", None, **body, code="custody.in_use")
    assert states(run) == ["held"]
    assert run.jobs.get().code == "custody.in_use"
    assert Ticket.objects.get().code == "custody.in_use"
    assert services.dispatch_ready() == 0
    assert Custody.objects.count() == 1
    assert live_locks() == 0


@pytest.mark.parametrize("lost", ["A", "arm"])
def test_a_host_that_is_lost_in_between_closes_the_rack(
    bench: Bench, hosts: dict[str, Host], lost: str
) -> None:
    run = a_run(bench, CARRY)
    services.dispatch_ready()
    if lost == "arm":
        hear(hosts["A"])
    edge = hosts[lost].edge
    edge.events = list(hosts[lost].disk.events)
    edge.event("boot", None)
    assert edge.send(edge.event("boot", None)) is None, "a gap"
    assert bench.node("rack").quarantined_by is not None
    assert Ticket.objects.filter(code="custody.conflict").count() == 1
    host_absence.isolate_hosts()
    services.dispatch_ready()
    assert run.jobs.get().attempts.count() == 0
    assert states(run)[0] in {"held", "suspended"}


def test_a_carry_in_doubt_stays_in_the_hands_of_the_arm(
    bench: Bench, hosts: dict[str, Host]
) -> None:
    run = a_run(bench, CARRY)
    to_the_arm(hosts)
    hosts["arm"].take()
    assert hosts["arm"].step(
        report=ActionReport(ok=False, effect=Effect.UNKNOWN, code="x", message="?")
    )
    hosts["arm"].tell()
    assert states(run) == ["in_doubt"]
    assert Custody.objects.count() == 1, "it is not handed on before a person has looked"
    assert bench.node("rack").quarantined_by is not None
    services.resolve_job(
        run.jobs.get().id,
        actor=bench.people["admin"],
        answer="happened",
        moved_nl=None,
        note="it stands there",
    )
    hear(hosts["arm"])
    assert states(run) == ["complete"]
    hear(hosts["arm"])
    hear(hosts["B"])
    assert holders(hosts, bench.node("rack")) == {"B"}
    assert live_locks() == 0


def test_a_job_whose_place_is_of_a_host_that_is_away_waits(
    bench: Bench, hosts: dict[str, Host]
) -> None:
    run = a_run(bench, CARRY)
    EdgeHost.objects.filter(key="bench 9").update(state="isolated")
    host_absence.isolate_hosts()
    assert states(run) == ["suspended"]
    assert services.dispatch_ready() == 0
    assert not Custody.objects.exists()


def test_what_was_plugged_in_after_the_start_is_not_carried(
    bench: Bench, hosts: dict[str, Host]
) -> None:
    run = a_run(bench, CARRY)
    Connection.objects.create(
        lab=bench.lab,
        key="late",
        source=bench.node("tube"),
        source_port="a",
        target=bench.node("valve_1"),
        target_port="b",
        medium="liquid",
    )
    assert services.dispatch_ready() == 0
    job = run.jobs.get()
    assert (job.state, job.code) == ("held", "crutd.connected")
    assert not Custody.objects.exists()


def test_a_carry_that_failed_is_done_by_hand_through_the_same_hands(
    bench: Bench, hosts: dict[str, Host]
) -> None:
    run = a_run(bench, CARRY)
    to_the_arm(hosts)
    hosts["arm"].take()
    assert hosts["arm"].step(
        report=ActionReport(ok=False, effect=Effect.NONE, code="x", message="no")
    )
    hosts["arm"].tell()
    job = run.jobs.get()
    assert job.state == "aborted"
    services.recover_job(
        job.id, choice="done_by_hand", actor=bench.people["chemist"], note="I carried it"
    )
    hear(hosts["arm"])
    made = Custody.objects.get(job=None)
    services.confirm_arrival(made.id, actor=bench.people["chemist"])
    hear(hosts["B"])
    assert bench.node("rack").parent_id == bench.node("bench_9").id
    assert holders(hosts, bench.node("rack")) == {"B"}
