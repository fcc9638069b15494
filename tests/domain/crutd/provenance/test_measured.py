"""Kept files and readings lead to what was measured, in the state that it was in."""

from __future__ import annotations

import json
from dataclasses import replace

from labweb.domain.crutd.provenance.graph_from_record import build_graph
from labweb.domain.crutd.provenance.prov_check import check_prov
from labweb.domain.crutd.provenance.prov_json_read import read_prov
from labweb.domain.crutd.provenance.prov_json_write import render_prov
from labweb.domain.crutd.provenance.provenance_graph import Bond, ProvGraph
from labweb.domain.crutd.provenance.recorded_facts import (
    Clue,
    FileFact,
    MeasurementFact,
    ReadingFact,
)
from tests.domain.crutd.provenance.records import LAB, RECORD, at

SPECTRUM = MeasurementFact(
    id="f1",
    seq=3,
    at=at(4),
    clue=Clue.JOB,
    name="scan.jdx",
    format="jcamp",
    media_type="chemical/x-jcamp-dx",
    size_bytes=900,
    sha256="ab" * 32,
    resource_id="v-reactor",
    device_id="d-ph",
    job_id="j5",
    kept_by_id="u1",
    readings=(
        ReadingFact(
            id="r9", name="uv", quantity="absorbance", unit="1", series={"points_count": 7}
        ),
        ReadingFact(id="r10", name="peak", quantity="wavelength", unit="nm", value=205.0),
    ),
    made=(
        FileFact(
            id="f2",
            name="scan.1.parquet",
            run_id="",
            media_type="x/y",
            size_bytes=3,
            sha256="c" * 64,
        ),
    ),
)


def graph_of(*measurements: MeasurementFact, **more: object) -> ProvGraph:
    return build_graph(replace(RECORD, measurements=measurements, **more))  # type: ignore[arg-type]


def ends(graph: ProvGraph, bond: Bond) -> set[tuple[str, str]]:
    return {(r.later, r.earlier) for r in graph.relations if r.bond is bond}


def test_a_reading_leads_over_its_file_to_the_state_that_was_measured() -> None:
    graph = graph_of(SPECTRUM)
    assert {("reading/r9", "file/f1"), ("file/f2", "file/f1")} <= ends(graph, Bond.DERIVED)
    assert ("file/f1", "measurement/f1") in ends(graph, Bond.GENERATED)
    assert ("measurement/f1", "state/v-reactor/3") in ends(graph, Bond.USED)
    assert graph.nodes["file/f1"].facts["sha256"] == "ab" * 32
    assert graph.nodes["reading/r9"].facts["points_count"] == 7
    assert graph.nodes["reading/r10"].facts["value"] == 205.0


def test_a_measurement_before_the_vessel_was_filled_is_not_of_what_came_later() -> None:
    graph = graph_of(replace(SPECTRUM, seq=2))
    assert ("measurement/f1", "resource/v-reactor") in ends(graph, Bond.USED)
    assert ("measurement/f1", "state/v-reactor/3") not in ends(graph, Bond.USED)


def test_a_measurement_is_borne_by_its_device_its_job_and_who_brought_the_file() -> None:
    graph = graph_of(SPECTRUM)
    assert ("measurement/f1", "job/j5") in ends(graph, Bond.INFORMED)
    agents = {("measurement/f1", "device/d-ph"), ("measurement/f1", "user/u1")}
    assert agents <= ends(graph, Bond.ASSOCIATED)
    assert ("file/f1", "device/d-ph") in ends(graph, Bond.ATTRIBUTED)


def test_a_moment_that_nobody_tells_is_not_claimed() -> None:
    node = graph_of(replace(SPECTRUM, clue=Clue.KEPT)).nodes["measurement/f1"]
    assert (node.started_at, node.ended_at) == ("", "")
    assert node.facts == {"moment_by": "kept", "counts_as_of": at(4)}


def test_a_kept_file_of_a_crate_is_the_measured_one_and_goes_by_its_place() -> None:
    packed = FileFact(
        id="f1", name="files/f1.jdx", run_id="r1", media_type="x/y", size_bytes=9, sha256="ab" * 32
    )
    graph = graph_of(SPECTRUM, files=(packed,))
    assert graph.nodes["file/f1"].name == "files/f1.jdx"
    assert ("file/f1", "run/r1") not in ends(graph, Bond.GENERATED)
    assert [n for n in graph.nodes if n.startswith("file/")] == ["file/f1", "file/f2"]


def test_its_prov_document_is_read_again_and_consistent() -> None:
    document = render_prov(graph_of(SPECTRUM), LAB)
    assert document["entity"]["lab:reading/r10"]["labweb:value"] == {
        "$": "205.0",
        "type": "xsd:double",
    }
    assert check_prov(read_prov(json.dumps(document).encode())) == []
