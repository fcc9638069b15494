"""The commands that bring a lab in and out: whole and equal, or not at all."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from django.core.management import call_command
from django.core.management.base import CommandError

from labweb.crutd.models import Entry, Event, Holding, Transaction
from labweb.crutd.selectors.lab_export import lab_file_of
from labweb.crutd.services import import_lab
from labweb.domain.graph.lab_file.apply_binding import apply_binding
from labweb.domain.graph.lab_file.binding_file import read_binding
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.graph_write import export_uni_lab_os
from labweb.enrollment.models import Device
from labweb.resources.models import Connection, Lab, Lot, Material, Resource
from labweb.resources.selectors import the_lab
from labweb.runs.services import stop_lab
from tests.builders import STARTER, Bench
from tests.corpus import GRAPHS, NO_GRAPHS
from tests.labs import generated_lab

ROOT = Path(__file__).parents[3]
BINDING = ROOT / "fixtures/bindings/uni_lab_os.json"
REFUSED = {
    "test.json",
    "large/prcxi_9320_visual.json",
    "devices.json",
    "empty_devices.json",
    "tests/resources/bioyond_materials_liquidhandling_1.json",
    "tests/workflow/example_prcxi.json",
}
NAMES = sorted(str(path.relative_to(GRAPHS)) for path in GRAPHS.rglob("*.json"))

published = pytest.mark.skipif(not NAMES, reason=NO_GRAPHS)


def run(name: str, *arguments: str) -> str:
    """Run a command and return what it prints."""
    out = StringIO()
    call_command(name, *arguments, stdout=out)
    return out.getvalue()


def stored(lab_file: LabFile) -> LabFile:
    """Write a lab and read it back from the rows alone."""
    row = import_lab(lab_file, actor=None, source={"file": "f"})
    return lab_file_of(Lab.objects.get(pk=row.pk))


def nothing_is_written() -> bool:
    tables = (Lab, Resource, Connection, Material, Lot, Entry, Event, Holding)
    return not any(table.objects.exists() for table in tables)


@pytest.fixture
def graph(tmp_path: Path) -> Path:
    """A graph with a pump on a valve, a bottle and a flask."""
    nodes: list[dict[str, Any]] = [
        {"id": "pump", "class": "virtual_transfer_pump", "config": {"max_volume": 25.0}},
        {"id": "valve", "class": "virtual_multiway_valve", "config": {"positions": 8}},
        {"id": "bottle", "class": "container", "config": {"max_volume": 500.0}},
        {"id": "thing", "class": "never_heard_of", "config": {"a": [1, {"b": None}]}},
    ]
    for node in nodes:
        node |= {"name": node["id"], "children": [], "parent": None, "type": "device", "data": {}}
    nodes[2]["data"] = {"liquid": [{"liquid_type": "water", "liquid_volume": 120.5}]}
    links = [
        link("l1", "fluid", ("pump", "transferpump"), ("valve", "transferpump")),
        link("l2", "fluid", ("valve", "1"), ("bottle", "top")),
    ]
    path = tmp_path / "bench_of_four.json"
    path.write_text(json.dumps({"nodes": nodes, "links": links, "note": "kept"}))
    return path


def link(key: str, sort: str, source: tuple[str, str], target: tuple[str, str]) -> dict[str, Any]:
    port = dict((source, target))
    return {"id": key, "source": source[0], "target": target[0], "type": sort, "port": port}


@pytest.mark.django_db
def test_a_lab_file_is_imported_and_comes_back_equal(tmp_path: Path) -> None:
    out = run("import_lab", str(STARTER / "lab.json"))
    assert out.startswith("lab.json: imported (")
    lab_file = read_lab((STARTER / "lab.json").read_bytes())
    assert Lab.objects.get().source["format"] == "labweb"
    run("export_lab", str(tmp_path / "out.json"))
    assert read_lab((tmp_path / "out.json").read_bytes()) == lab_file
    assert read_lab(run("export_lab", "--lab", Lab.objects.get().key).encode()) == lab_file


@pytest.mark.django_db
@pytest.mark.parametrize("seed", range(8))
def test_generated_labs_come_back_equal_from_their_rows(seed: int) -> None:
    lab_file = read_lab(generated_lab(seed))
    assert stored(lab_file) == lab_file


@pytest.mark.django_db
def test_texts_as_long_as_a_file_may_have_are_kept() -> None:
    lab = json.loads(generated_lab(3))
    lab["name"] = "N" * 500
    lab["resources"][0]["name"] = "n" * 500
    lab["connections"][0]["key"] = "k" * 500
    lab["lots"][0] |= {"supplier": "s" * 900, "purity": "p" * 300, "expires_on": "2030-02-28"}
    lab["materials"][0] |= {"ph": -1.5}
    lab_file = read_lab(json.dumps(lab).encode())
    assert stored(lab_file) == lab_file


@pytest.mark.django_db
@pytest.mark.parametrize(
    ("name", "key"), [("A lab", "a-lab"), ("实验室", None), ("Лаборатория", None)]
)
def test_a_lab_whose_name_gives_no_key_has_its_id_as_key(name: str, key: str | None) -> None:
    lab_file = read_lab(json.dumps(json.loads(generated_lab(4)) | {"name": name}).encode())
    assert import_lab(lab_file, actor=None, source={}).key == (key or lab_file.id.hex)


@pytest.mark.django_db
def test_a_graph_is_bound_imported_and_comes_back_deep_equal(graph: Path, tmp_path: Path) -> None:
    told = json.loads(run("import_lab", str(graph), "--json", "--bind", str(BINDING)))
    assert (told["verdict"], told["format"]) == ("imported", "uni_lab_os")
    assert told["kinds"] == {
        **{"foreign": 1, "lab": 1, "rotary_valve": 1, "syringe_pump": 1, "vessel": 1, "timer": 2}
    }
    assert told["counts"]["devices"] == 3
    assert [note["subject"] for note in told["notes"] if note["code"] == "binding.unmapped"] == [
        "thing"
    ]
    assert Holding.objects.get().amount_nl == 120_500_000
    run("export_lab", "--format", "uni-lab-os", str(tmp_path / "back.json"))
    assert json.loads((tmp_path / "back.json").read_text()) == json.loads(graph.read_text())


@pytest.mark.django_db
def test_a_check_says_everything_and_writes_nothing(graph: Path) -> None:
    out = run("import_lab", str(graph), "--check")
    assert out.startswith("bench_of_four.json: checked (")
    assert "binding.unmapped" in out
    assert nothing_is_written()


@pytest.mark.django_db
@pytest.mark.parametrize("flags", [[], ["--check"], ["--json"]])
def test_a_refused_file_changes_nothing_and_says_every_finding(
    graph: Path, flags: list[str]
) -> None:
    value = json.loads(graph.read_text())
    value["nodes"][0]["parent"] = "nobody"
    value["links"][0]["target"] = "nowhere"
    graph.write_text(json.dumps(value))
    out = StringIO()
    with pytest.raises(CommandError) as caught:
        call_command("import_lab", str(graph), *flags, stdout=out)
    assert caught.value.returncode == 1
    assert "refused" in out.getvalue()
    assert "tree.dangling_parent" in out.getvalue()
    if "--json" in flags:
        assert json.loads(out.getvalue())["findings"]
    assert nothing_is_written()


@pytest.mark.django_db
def test_a_lab_is_not_imported_twice(graph: Path) -> None:
    run("import_lab", str(graph))
    before = (Resource.objects.count(), Entry.objects.count(), Event.objects.count())
    with pytest.raises(CommandError, match=r"lab\.exists"):
        run("import_lab", str(graph))
    assert (Resource.objects.count(), Entry.objects.count(), Event.objects.count()) == before


def test_another_lab_is_refused_and_the_first_stays_the_one_that_is_stopped(
    bench: Bench, graph: Path
) -> None:
    before = (Resource.objects.count(), Entry.objects.count(), Event.objects.count())
    with pytest.raises(CommandError, match=r"lab\.exists_other.*data directory"):
        run("import_lab", str(graph))
    assert (Resource.objects.count(), Entry.objects.count(), Event.objects.count()) == before
    assert run("import_lab", str(graph), "--check").startswith("bench_of_four.json: checked (")
    assert the_lab() == bench.lab
    stop_lab(actor=bench.people["chemist"])
    assert the_lab().is_stopped


def test_of_two_labs_from_before_the_rule_the_first_imported_is_the_one_that_runs(
    bench: Bench,
) -> None:
    for number in (0, 2**128 - 1):
        Lab.objects.create(id=UUID(int=number), key=f"lab-{number}", name="Other", mode="sim")
        assert the_lab() == bench.lab


@pytest.mark.django_db
def test_no_file_no_lab_and_no_folder_are_said_plainly(tmp_path: Path) -> None:
    for arguments in (
        ("import_lab", str(tmp_path / "none.json")),
        ("import_lab", "--report", str(tmp_path / "none")),
        ("export_lab",),
        ("export_lab", "--lab", "none"),
        ("import_lab",),
    ):
        with pytest.raises(CommandError):
            run(*arguments)
    assert nothing_is_written()


@pytest.mark.django_db
def test_a_folder_is_reported_as_a_table_or_as_json(graph: Path) -> None:
    (graph.parent / "broken.json").write_text("{}")
    lines = run("import_lab", "--report", str(graph.parent)).splitlines()
    assert lines[0].split() == ["verdict", "nodes", "links", "foreign", "file", "findings"]
    assert [line.split()[0] for line in lines[1:]] == ["imported", "refused"]
    told = json.loads(run("import_lab", "--report", str(graph.parent), "--json"))
    assert [row["verdict"] for row in told] == ["imported", "refused"]
    assert nothing_is_written()


def test_what_has_changed_since_is_exported_as_it_is(bench: Bench) -> None:
    node = Resource.objects.filter(lab=bench.lab, kind="bottle")[0]
    Resource.objects.filter(pk=node.pk).update(data={"seen": True}, name="Renamed")
    held = Holding.objects.get(resource_id=node.pk)
    Entry.objects.create(
        transaction=Transaction.objects.get(),
        lot_id=held.lot_id,
        debit=str(node.pk),
        credit="LOSS",
        amount_nl=held.amount_nl - 1,
        state="posted",
        at=Transaction.objects.get().proposed_at,
    )
    retired, candidate, kept = [device.key for device in bench.file.devices][:3]
    states = {retired: Device.State.RETIRED, candidate: Device.State.CANDIDATE}
    for key, state in states.items():
        Device.objects.filter(key=key).update(state=state)
    Device.objects.filter(key=kept).update(name="Renamed device", transport="serial:///dev/none")
    exported = lab_file_of(bench.lab)
    found = exported.tree.by_id[node.pk]
    assert (found.name, found.data) == ("Renamed", {"seen": True})
    assert list(exported.contents[node.pk].values()) == [1]
    devices = {device.key: device for device in exported.devices}
    assert devices.keys() == {device.key for device in bench.file.devices} - {retired}
    assert exported.discovered == (candidate,)
    assert devices[kept].name == "Renamed device"
    declared = next(device for device in bench.file.devices if device.key == kept)
    assert (devices[kept].transport, devices[kept].simulator) == (None, declared.simulator)
    assert read_lab(render_lab(exported)) == exported


def test_a_device_that_no_file_declared_is_exported_with_its_address(bench: Bench) -> None:
    row = bench.device(bench.file.devices[0].key)
    Lab.objects.update(extra={})
    exported = lab_file_of(Lab.objects.get())
    found = next(device for device in exported.devices if device.id == row.pk)
    assert (found.transport, found.simulator) == (row.transport, None)
    assert found.driver == bench.file.devices[0].driver
    assert [host.id for host in exported.hosts] == [bench.host.pk]


@published
@pytest.mark.django_db
@pytest.mark.parametrize("name", [name for name in NAMES if name not in REFUSED])
def test_every_published_graph_comes_back_deep_equal_from_its_rows(name: str) -> None:
    raw = (GRAPHS / name).read_bytes()
    lab_file, _ = apply_binding(read_uni_lab_os(raw, name), read_binding(BINDING.read_bytes()))
    back = stored(lab_file)
    assert back == lab_file
    assert export_uni_lab_os(back) == json.loads(raw)
