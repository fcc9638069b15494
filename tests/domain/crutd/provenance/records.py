"""A run on record: water ──▶ syringe ──▶ reactor, which stands in a heater; then a pH reading."""

from __future__ import annotations

from typing import Any

from labweb.domain.crutd.provenance.ledger_flows import LedgerFlow
from labweb.domain.crutd.provenance.recorded_facts import (
    DecisionFact,
    DeviceFact,
    FileFact,
    JobFact,
    LotFact,
    RecordedFacts,
    ResourceFact,
    RunFact,
    TransactionFact,
)
from tests.domain.crutd.provenance.ledgers import flow

LAB = "0190a000-0000-7000-8000-000000000000"
FLOWS: tuple[LedgerFlow, ...] = (
    flow(1, "RECEIPT", "v-water", activity="t1", water=9000),
    flow(2, "v-water", "v-syringe", activity="t2", water=5000),
    flow(3, "v-syringe", "v-reactor", activity="t3", water=5000),
)


def at(second: int) -> str:
    return f"2026-03-04T05:06:{second:02}Z"


def done(number: int, name: str, op: dict[str, Any], **more: Any) -> TransactionFact:  # noqa: ANN401 - fields of the fact
    return TransactionFact(
        **{
            "id": f"t{number}",
            "seq": number,
            "name": name,
            "state": "committed",
            "started_at": at(number),
            "ended_at": at(number + 1),
            "operation": op,
            "verification": "device",
            "event_hash": f"{number:064x}",
            "job_id": f"j{number}",
            **more,
        }
    )


def job(number: int, device: str, sentence: str, **more: Any) -> JobFact:  # noqa: ANN401 - fields of the fact
    return JobFact(
        **{
            "id": f"j{number}",
            "run_id": "r1",
            "index": number,
            "sentence": sentence,
            "action": "act",
            "state": "complete",
            "device_id": device,
            "host_id": "h1",
            "driver_digest": f"{device}-digest",
            "started_at": at(number),
            "ended_at": at(number + 1),
            "worker_pid": 4242,
            **more,
        }
    )


def pour(source: str, target: str) -> dict[str, Any]:
    return {
        "op": "transfer_liquid", "source_id": source, "target_id": target, "amount_nl": 5000,
    }  # fmt: skip


TRANSACTIONS = (
    done(1, "create", {"op": "create", "resource_id": "v-lab"}, job_id="", actor_id="u1"),
    done(2, "transfer", pour("v-water", "v-syringe")),
    done(3, "transfer", pour("v-syringe", "v-reactor")),
    done(4, "update", {"op": "update", "resource_id": "n-heater", "data": {"temp c": 60.5}}),
    done(5, "read", {"op": "read", "device_id": "d-ph", "statuses": ["ph"]}),
    done(
        6,
        "transfer",
        {
            "op": "transfer_resource",
            "resource_id": "v-reactor",
            "from_id": "n-heater",
            "to_id": "n-bench",
        },
        job_id="",
        actor_id="u1",
    ),
    done(7, "transfer", pour("v-reactor", "v-water"), state="quarantined", job_id="j7"),
)
RECORD = RecordedFacts(
    root="resource/v-reactor",
    flows=FLOWS,
    transactions=TRANSACTIONS,
    jobs=(
        job(2, "d-pump", "Aspirate 5.00 µL from Water"),
        job(3, "d-pump", "Dispense 5.00 µL into Reactor"),
        job(4, "d-heater", "Bring Reactor to 60.5 °C"),
        job(5, "d-ph", 'Read the "pH"', report={"ok": True, "data": {"ph": 7.01}}),
        job(7, "d-pump", "Aspirate", state="aborted", resolved_by="u2"),
    ),
    runs=(
        RunFact(
            id="r1",
            number=7,
            state="complete",
            workflow="Move & heat",
            version_id="w1",
            version_number=3,
            version_digest="abc",
            version_author_id="u1",
            version_at=at(0),
            plan_digest="def",
            created_by_id="u1",
            started_at=at(1),
            ended_at=at(9),
        ),
    ),
    decisions=(
        DecisionFact(
            id="a1", run_id="r1", actor_id="u2", meaning="I approve", is_approved=True, at=at(1)
        ),
    ),
    devices=(
        DeviceFact(id="d-pump", name="Pump 1", host_id="h1", nodes=("v-syringe",)),
        DeviceFact(id="d-heater", name="Heater 1", host_id="h1", nodes=("n-heater",)),
        DeviceFact(id="d-ph", name="pH 1", host_id="h1", nodes=("n-ph",)),
    ),
    resources=(
        ResourceFact(id="v-water", name="Water", kind="bottle"),
        ResourceFact(id="v-syringe", name="Syringe", kind="syringe_pump"),
        ResourceFact(id="v-reactor", name="Reactor", kind="reactor", collection_id="n-rack"),
        ResourceFact(id="n-rack", name="Rack", kind="tube_rack"),
        ResourceFact(id="n-heater", name="Heater", kind="heater_stirrer"),
        ResourceFact(id="n-bench", name="Bench", kind="bench"),
        ResourceFact(id="n-ph", name="pH", kind="transmitter"),
    ),
    lots=(LotFact(id="water", name="Water W-1", material="Water", number="W-1"),),
    files=(
        FileFact(name="a b.parquet", run_id="r1", media_type="x/y", size_bytes=3, sha256="0" * 64),
    ),
    hosts={"h1": "edge-1"},
    people={"u1": "Cleo Chemist", "u2": "Ana Approver"},
    drivers={"d-pump-digest": "TricontinentC3000"},
)
