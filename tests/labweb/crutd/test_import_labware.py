"""The command that brings labware into a lab: whole, or not at all."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path
from typing import Any
from uuid import uuid5

import pytest
from django.core.management import call_command
from django.core.management.base import CommandError
from django.db import connection
from django.test.utils import CaptureQueriesContext

from labweb.accounts.models import AuditEntry
from labweb.crutd.models import Event, EventSubject, ResourceLock, Transaction
from labweb.crutd.selectors import snapshot
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.crutd.selectors.lab_export import lab_file_of
from labweb.crutd.services import import_labware, lock_operation
from labweb.domain.crutd.operations import Update
from labweb.domain.errors import DefinitionError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.resources.models import Lab, Resource
from tests.builders import Bench
from tests.domain.resources.labware_files import Json, an_opentrons_plate


def run(*arguments: str) -> str:
    out = StringIO()
    call_command("import_labware", *arguments, stdout=out)
    return out.getvalue()


@pytest.fixture
def plate(tmp_path: Path) -> str:
    return written(tmp_path, an_opentrons_plate())


def written(folder: Path, value: Any) -> str:  # noqa: ANN401 - JSON
    path = folder / "labware.json"
    path.write_text(json.dumps(value))
    return str(path)


def a_rack() -> Json:
    parameters = {"isTiprack": True, "loadName": "rack", "tipLength": 50}
    metadata = {"displayName": "Rack", "displayCategory": "tipRack"}
    return an_opentrons_plate(parameters=parameters, metadata=metadata)


def counts() -> list[int]:
    tables = (Resource, Transaction, Event, EventSubject, ResourceLock, AuditEntry)
    return [table.objects.count() for table in tables]


@pytest.mark.django_db
def test_a_plate_is_created_by_one_transaction_with_its_wells(bench: Bench, plate: str) -> None:
    transactions, events = Transaction.objects.count(), Event.objects.count()
    out = run(plate, "--into", "bench_1", "--key", "plate_1", "--name", "Plate 1")
    assert out == "labware.json: imported (1 plate, 2 well)\n"
    row = Resource.objects.get(key="plate_1")
    assert (row.name, row.kind, row.parent.key if row.parent else "") == (
        "Plate 1",
        "plate",
        "bench_1",
    )
    assert row.pose is None
    assert row.size_mm == [40, 30, 14]
    wells = {well.key: well for well in Resource.objects.filter(parent=row)}
    assert set(wells) == {"plate_1/A1", "plate_1/B1"}
    first = wells["plate_1/A1"]
    assert first.id == uuid5(row.id, "A1")
    assert first.pose is not None
    assert first.pose["x_mm"] == 7
    assert first.config["cavity"][0]["shape"] == "conical"
    assert snapshot([first])[first.id].capacity_nl == 250_500
    assert Transaction.objects.count() == transactions + 1
    assert Event.objects.count() == events + 1
    event = Event.objects.order_by("-seq")[0]
    assert (event.name, event.state) == ("create", "committed")
    assert event.body["operation"]["resource_id"] == str(row.id)
    assert event.body["message"] == "imported 3 resources from labware.json"
    assert not ResourceLock.objects.filter(released_at__isnull=True).exists()
    entry = AuditEntry.objects.get(action="labware.import")
    assert entry.subject == str(row.id)
    assert entry.detail["format"] == "opentrons/2"
    assert len(entry.detail["sha256"]) == 64


@pytest.mark.django_db
def test_a_lab_with_labware_is_exported_and_comes_back_equal(bench: Bench, plate: str) -> None:
    run(plate, "--into", "bench_1", "--name", "plate_1")
    lab_file = lab_file_of(Lab.objects.get(pk=bench.lab.pk))
    assert any(resource.key == "plate_1/B1" for resource in lab_file.resources)
    assert read_lab(render_lab(lab_file)) == lab_file


@pytest.mark.django_db
def test_a_lab_with_labware_is_rebuilt_from_its_events(bench: Bench, plate: str) -> None:
    run(plate, "--into", "bench_1", "--name", "Plate 1")
    assert rebuild_differences(bench.lab) == []


@pytest.mark.django_db
def test_a_rack_brings_tips_only_when_a_person_says_that_it_is_full(
    bench: Bench, tmp_path: Path
) -> None:
    path = written(tmp_path, a_rack())
    assert "(1 tip_rack, 2 tip_spot)" in run(path, "--into", "bench_1", "--name", "empty")
    out = run(path, "--into", "bench_1", "--name", "full", "--full")
    assert "(2 tip, 1 tip_rack, 2 tip_spot)" in out
    tip = Resource.objects.get(key="full/A1/tip")
    assert tip.parent is not None
    assert tip.parent.key == "full/A1"


@pytest.mark.django_db
def test_a_check_tells_the_same_and_writes_nothing(bench: Bench, plate: str) -> None:
    before = counts()
    out = run(plate, "--into", "bench_1", "--name", "plate_1", "--check", "--json")
    told = json.loads(out)
    assert (told["verdict"], told["format"]) == ("checked", "opentrons/2")
    assert told["kinds"] == {"plate": 1, "well": 2}
    assert told["resource"]["key"] == "plate_1"
    assert counts() == before


@pytest.mark.django_db
@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("--into", "nowhere", "--name", "p"), "resource.not_found"),
        (("--into", "water_bottle", "--name", "p"), "resource.not_found"),
        (("--into", "pump_1", "--name", "p"), "crutd.no_place"),
        (("--into", "bench_1", "--name", "p", "--key", "pump_1"), "labware.exists"),
        (("--into", "bench_1", "--name", " "), "labware.invalid"),
        (("--into", "bench_1", "--name", "p", "--key", "k" * 499), "labware.invalid"),
        (("--into", "bench_1", "--name", "p", "--full"), "labware.invalid"),
    ],
)
def test_labware_that_has_no_place_in_the_lab_changes_nothing(
    bench: Bench, plate: str, arguments: tuple[str, ...], code: str
) -> None:
    before = counts()
    for extra in ((), ("--check",)):
        with pytest.raises(CommandError, match=code):
            run(plate, *arguments, *extra)
    assert counts() == before


@pytest.mark.django_db
def test_a_definition_that_is_wrong_is_told_field_by_field(bench: Bench, tmp_path: Path) -> None:
    value = an_opentrons_plate(dimensions={"xDimension": -1, "yDimension": "wide"})
    path = written(tmp_path, value)
    before = counts()
    out = StringIO()
    with pytest.raises(CommandError):
        call_command(
            *("import_labware", path, "--into", "bench_1", "--name", "p", "--json"), stdout=out
        )
    told = json.loads(out.getvalue())
    assert told["verdict"] == "refused"
    assert [(finding["code"], finding["subject"]) for finding in told["findings"]] == [
        ("labware.number", "dimensions.xDimension"),
        ("labware.field", "dimensions.yDimension"),
        ("labware.missing", "dimensions.zDimension"),
    ]
    assert counts() == before


@pytest.mark.django_db
@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("{", "lab_file.json"),
        ('{"schemaVersion": NaN}', "lab_file.number"),
        ("[" * 100 + "]" * 100, "lab_file.depth"),
        ("{}", "labware.unknown_format"),
        ('{"a": 1, "a": 2}', "lab_file.duplicate_key"),
    ],
)
def test_a_file_that_is_no_labware_is_refused(
    bench: Bench, tmp_path: Path, text: str, code: str
) -> None:
    path = tmp_path / "labware.json"
    path.write_text(text)
    with pytest.raises(CommandError, match=code):
        run(str(path), "--into", "bench_1", "--name", "p")


@pytest.mark.django_db
def test_a_file_that_is_not_there_is_told(bench: Bench, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="cannot read the file"):
        run(str(tmp_path / "none.json"), "--into", "bench_1", "--name", "p")


@pytest.mark.django_db
def test_the_same_labware_comes_once(bench: Bench, plate: str) -> None:
    run(plate, "--into", "bench_1", "--name", "plate_1")
    before = counts()
    with pytest.raises(CommandError, match=r"labware\.exists"):
        run(plate, "--into", "bench_1", "--name", "plate_1")
    assert counts() == before


@pytest.mark.django_db
def test_labware_waits_for_a_place_that_is_in_use(bench: Bench, plate: str) -> None:
    place = Resource.objects.get(key="bench_1")
    lock_operation(Update(resource_id=place.id, data={}), lab=bench.lab, targets=(), actor_id=None)
    before = counts()
    with pytest.raises(CommandError, match=r"crutd\.locked"):
        run(plate, "--into", "bench_1", "--name", "plate_1")
    assert counts() == before


@pytest.mark.django_db
def test_nothing_is_no_labware(bench: Bench) -> None:
    with pytest.raises(DefinitionError):
        import_labware([], lab=bench.lab, actor=None, source={})


@pytest.mark.django_db
def test_a_plate_of_1536_wells_takes_as_many_queries_as_one_of_two(
    bench: Bench, tmp_path: Path, plate: str
) -> None:
    with CaptureQueriesContext(connection) as few:
        run(plate, "--into", "bench_1", "--name", "small")
    value = an_opentrons_plate()
    rows = [chr(65 + n) if n < 26 else f"A{chr(65 + n - 26)}" for n in range(32)]
    well = value["wells"]["A1"]
    value["dimensions"] = {"xDimension": 400, "yDimension": 300, "zDimension": 14}
    value["wells"] = {
        f"{row}{column}": {**well, "x": 7.0 * column, "y": 290.0 - 7.0 * place}
        for column in range(1, 49)
        for place, row in enumerate(rows)
    }
    value["ordering"] = [[f"{row}{column}" for row in rows] for column in range(1, 49)]
    path = written(tmp_path, value)
    with CaptureQueriesContext(connection) as many:
        assert "1536 well" in run(path, "--into", "bench_1", "--name", "large")
    assert len(many) == len(few)
