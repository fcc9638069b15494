"""Operations by hand, as a person sends them, and what is looked at after each."""

from __future__ import annotations

from typing import Any
from uuid import uuid4

from labweb.crutd.models import Entry, Event, Holding, ResourceLock, Transaction
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.resources.models import Lot, Material, Resource
from tests.builders import Bench
from tests.labweb.web import call, signed_in

LATER = "2999-12-31"


def post(bench: Bench, operation: dict[str, Any], *, role: str = "chemist", at: str = "") -> Any:  # noqa: ANN401
    client = signed_in(bench.people[role])
    answer = call(client, "POST", f"/api/v1/operations{at}", {"operation": operation})
    return answer.status_code, answer.json()  # type: ignore[attr-defined]


def done(bench: Bench, operation: dict[str, Any]) -> dict[str, Any]:
    """Carry an operation out; the ledger holds and the events tell the same."""
    status, told = post(bench, operation)
    assert status == 201, told
    assert ledger_violations(bench.lab) == []
    assert rebuild_differences(bench.lab) == []
    assert not ResourceLock.objects.filter(released_at=None, transaction=told["transaction_id"])
    found: dict[str, Any] = told
    return found


def rows() -> tuple[Any, ...]:
    models = (Entry, Event, Transaction, Lot, Resource)
    held = list(Holding.objects.order_by("id").values())
    places = list(Resource.objects.order_by("id").values("id", "parent_id", "is_archived"))
    return [model._default_manager.count() for model in models], held, places


def refused(bench: Bench, operation: dict[str, Any], code: str) -> dict[str, Any]:
    """Have an operation refused with a code, and nothing changed by it."""
    before = rows()
    status, told = post(bench, operation, at="/check")
    assert (status, [one["code"] for one in told["findings"]]) == (200, [code]), told
    status, told = post(bench, operation)
    assert (status, told["code"], told["effect"]) == (412, code, "none"), told
    assert rows() == before
    found: dict[str, Any] = told
    return found


def node(bench: Bench, key: str) -> str:
    return str(bench.node(key).id)


def held(bench: Bench, key: str) -> dict[str, tuple[int, int]]:
    """Return nanolitres and micrograms by the key of the lot."""
    found = Holding.objects.filter(resource=bench.node(key)).select_related("lot")
    return {h.lot.key: (h.amount_nl, h.amount_ug) for h in found if h.amount_nl or h.amount_ug}


def nl(bench: Bench, key: str) -> int:
    return sum(amount for amount, _ in held(bench, key).values())


def material(bench: Bench, **fields: Any) -> Material:  # noqa: ANN401
    return Material.objects.create(lab=bench.lab, **{"key": "acid", "name": "Acid"} | fields)


def delivery(bench: Bench, to: str = "flask_1", **fields: Any) -> dict[str, Any]:  # noqa: ANN401
    found = Material.objects.filter(key="acid").first() or material(bench)
    plain = {
        "op": "receive",
        "lot_id": str(uuid4()),
        "material_id": str(found.id),
        "key": f"lot {uuid4()}",
        "number": f"N-{uuid4()}",
        "supplier": "S",
        "phase": "liquid",
        "portions": [{"resource_id": node(bench, to), "amount_nl": 1_000_000}],
    }
    return plain | fields


def a_jar(bench: Bench, key: str) -> None:
    """Put a jar on the bench that says how much of a solid it holds."""
    create = {"op": "create", "resource_id": str(uuid4()), "parent_id": node(bench, "bench_1")}
    config = {"capacity_mg": 100, "capacity_ul": 100_000}
    done(bench, create | {"key": key, "name": key.title(), "kind": "vial", "config": config})


def solid(bench: Bench, to: str, amount_ug: int, **fields: Any) -> dict[str, Any]:  # noqa: ANN401
    portions = [{"resource_id": node(bench, to), "amount_ug": amount_ug}]
    return delivery(bench, to, phase="solid", portions=portions, **fields)


def pour(bench: Bench, source: str, target: str, amount_nl: int) -> dict[str, Any]:
    ends = {"source_id": node(bench, source), "target_id": node(bench, target)}
    return {"op": "transfer_liquid", "amount_nl": amount_nl, **ends}
