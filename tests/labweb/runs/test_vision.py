"""A vial is carried under cameras: from the workflow to the record, with the picture as evidence.

```text
shelf ──arm──▶ bench        a camera above each
```
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from pytest_django import Settings

from fixtures.instruments.sensors.photograph import drawn, exposed
from labweb.common.clock import new_id
from labweb.crutd import services as crutd_services
from labweb.crutd.models import Transaction
from labweb.domain.action_files import PART_BYTES, UNKNOWN, FilePart, FileParts
from labweb.domain.crutd.operations import Create
from labweb.domain.crutd.pre_and_postconditions import Readings, spread
from labweb.enrollment import services as enrollment_services
from labweb.runs import services
from labweb.runs.models import Attempt, Run
from labweb.runs.services.action_files import REFUSED
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry.models import File
from labweb.workflows import services as workflow_services
from tests.builders import Bench, catalog
from tests.labweb.runs.hosts import Host

CAMERA = "drivers.sensors.network_camera:NetworkCamera"
ARM = "drivers.logistics.ur_dashboard:UrDashboard"
SURE = {"presence_confidence_ratio": 0.97, "tag_confidence_ratio": 0.97}


@pytest.fixture
def cell(bench: Bench, settings: Settings, tmp_path: Path) -> Bench:
    """Add a shelf with a vial, an arm, and two cameras to the starter lab."""
    settings.DATA_DIR = tmp_path
    for key, kind, parent in (
        ("shelf", "slot", "bench_1"),
        ("table", "slot", "bench_1"),
        ("vial", "vial", "shelf"),
        ("arm", "workstation", "bench_1"),
        ("shelf_eye", "transmitter", "bench_1"),
        ("table_eye", "transmitter", "bench_1"),
    ):
        create = Create(
            resource_id=new_id(), parent_id=bench.node(parent).id, key=key, name=key, kind=kind
        )
        crutd_services.carry_out(create, lab=bench.lab, actor_id=bench.people["admin"].pk)
    a_device(bench, "arm", ARM, "arm", {"programs": ["fetch.urp"]})
    for key in ("shelf_eye", "table_eye"):
        a_device(bench, key, CAMERA, "camera", {"place_tag": key.partition("_")[0]})
    return bench


def a_device(bench: Bench, key: str, driver: str, role: str, config: dict[str, Any]) -> None:
    enrollment_services.found_device(
        bench.lab,
        new_id(),
        key=key,
        name=key,
        host_id=bench.host.id,
        driver=enrollment_services.keep_driver(catalog()[driver]),
        transport=f"virtual:{key}",
        config=config,
        nodes={role: str(bench.node(key).id)},
        state="enrolled",
    )


def started(cell: Bench) -> Run:
    params = {
        "resource": str(cell.node("vial").id),
        "place": str(cell.node("table").id),
        "device": str(cell.node("arm").id),
        "action": "run_program",
        "args": {"program": "fetch.urp"},
        "tag": "VIAL-7",
        "guard_with": str(cell.node("shelf_eye").id),
        "confirm_with": str(cell.node("table_eye").id),
    }
    step = {"id": "c", "kind": "carry", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": "Fetch", "steps": [step], "edges": []}
    chemist = cell.people["chemist"]
    workflow = workflow_services.create_workflow(
        cell.lab, name="Fetch", document=document, actor=chemist
    )
    version = workflow_services.save_version(workflow.id, note="", actor=chemist)
    return services.start_run(version, actor=chemist)


def a_picture() -> bytes:
    return exposed(drawn(["table"], {"table": "VIAL-7"}))


def seen(cell: Bench, eye: str, picture: bytes, **fields: Any) -> Readings:  # noqa: ANN401
    sighting = {"is_present": True, "tag": "VIAL-7", **SURE, **fields}
    sighting["image_sha256"] = hashlib.sha256(picture).hexdigest()
    return spread(cell.device(eye).id, "sighting", sighting)


def carried(cell: Bench, before: Readings, after: Readings) -> Attempt:
    """Start the workflow, and have the host carry it out on what its cameras saw."""
    run = started(cell)
    host = Host(cell)
    assert services.dispatch_ready() == 1
    host.take()
    assert host.step(before=before, after=after)
    host.tell()
    return Attempt.objects.select_related("job", "transaction").get(job__run=run)


def parts(cell: Bench, attempt: Attempt, eye: str, data: bytes, **fields: Any) -> list[FilePart]:  # noqa: ANN401
    told = {"sha256": hashlib.sha256(data).hexdigest(), "size_bytes": len(data), **fields}
    return [
        FilePart(
            epoch=1, action_id=attempt.pk, device_id=cell.device(eye).id,
            offset_bytes=at, data=data[at : at + PART_BYTES], **told,
        )
        for at in range(0, len(data), PART_BYTES)
    ]  # fmt: skip


def test_a_carry_that_was_seen_is_committed_as_sensed_with_its_picture(cell: Bench) -> None:
    before, after = a_picture(), a_picture()
    attempt = carried(cell, seen(cell, "shelf_eye", before), seen(cell, "table_eye", after))
    assert attempt.job.state == "complete"
    record = Transaction.objects.get(pk=attempt.transaction_id)
    assert (record.state, record.verification) == ("committed", "sensed")
    assert cell.node("vial").parent_id == cell.node("table").id
    confirmed = attempt.job.evidence["post"][0]["evidence"]
    assert confirmed["image_sha256"] == hashlib.sha256(after).hexdigest()
    assert confirmed["camera_id"] == str(cell.device("table_eye").id)
    assert confirmed["confidence"] == 0.97

    for eye, picture in (("shelf_eye", before), ("table_eye", after)):
        (part,) = parts(cell, attempt, eye, picture)
        assert services.take_file(cell.host.id, part, picture) == ""
        assert services.take_file(cell.host.id, part, picture) == "", "once is enough"
    kept = File.objects.get(sha256=confirmed["image_sha256"])
    assert (kept.job_id, kept.device_id) == (attempt.job_id, cell.device("table_eye").id)
    assert kept.media_type == "image/jpeg"
    assert telemetry_selectors.path_of(kept.sha256).read_bytes() == after
    assert File.objects.count() == 2


def test_what_no_event_names_and_what_is_another_picture_is_not_kept(cell: Bench) -> None:
    after = a_picture()
    attempt = carried(cell, seen(cell, "shelf_eye", after), seen(cell, "table_eye", after))
    other = a_picture()
    (part,) = parts(cell, attempt, "table_eye", other)
    assert services.take_file(cell.host.id, part, other) == UNKNOWN
    (forged,) = parts(cell, attempt, "table_eye", other, sha256=hashlib.sha256(after).hexdigest())
    assert services.take_file(cell.host.id, forged, other) == REFUSED
    (part,) = parts(cell, attempt, "table_eye", after)
    assert services.take_file(new_id(), part, after) == REFUSED
    assert File.objects.count() == 0


@pytest.mark.parametrize(
    "fields",
    [{"tag": "VIAL-8"}, {"is_present": False, "tag": ""}, {"tag_confidence_ratio": 0.5}],
    ids=["another vial", "nothing there", "not sure"],
)
def test_a_guard_that_does_not_see_the_vial_refuses(cell: Bench, fields: dict[str, Any]) -> None:
    picture = a_picture()
    attempt = carried(cell, seen(cell, "shelf_eye", picture, **fields), {})
    assert (attempt.job.state, attempt.job.code) == ("rejected", "camera.tag")
    assert attempt.transaction.state == "rolled_back"
    assert cell.node("vial").parent_id == cell.node("shelf").id
    (part,) = parts(cell, attempt, "shelf_eye", picture)
    assert services.take_file(cell.host.id, part, picture) == "", "a refusal has evidence, too"


def test_a_camera_that_cannot_tell_after_the_carry_leaves_it_quarantined(cell: Bench) -> None:
    attempt = carried(cell, seen(cell, "shelf_eye", a_picture()), {})
    assert attempt.job.state == "in_doubt"
    assert attempt.transaction.state == "quarantined"
    assert attempt.job.verification == "assumed"
    assert cell.node("vial").quarantined_by is not None
    assert cell.node("vial").parent_id == cell.node("shelf").id, "nothing is claimed"


def test_a_file_comes_together_from_its_parts_in_order_and_from_nothing_else() -> None:
    data = bytes(range(256)) * 2000

    def part(offset: int, length: int = 200_000, **fields: Any) -> FilePart:  # noqa: ANN401
        known: dict[str, Any] = {"size_bytes": len(data), "sha256": "a"} | fields
        return FilePart(
            epoch=1,
            action_id=UUID(int=1),
            device_id=UUID(int=2),
            offset_bytes=offset,
            data=data[offset : offset + length],
            **known,
        )

    whole = FileParts()
    assert whole.add(part(0)) is None
    assert whole.add(part(200_000)) is None
    assert whole.add(part(400_000)) == data
    assert whole.add(part(400_000)) is None, "it does not begin in the middle"
    whole.add(part(0))
    assert whole.add(part(400_000)) is None, "a part is missing"
    whole.add(part(0))
    whole.add(part(200_000, sha256="b"))
    assert whole.add(part(400_000)) is None, "another file came between"
    assert whole.add(part(0, 200_000, size_bytes=100)) is None
    assert whole.add(part(0, 100, size_bytes=2**40)) is None
