"""The corpora of the `prov` package, of ProvToolbox and of the W3C."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from prov.model import ProvDocument

from labweb.domain.crutd.provenance.prov_check import check_prov
from labweb.domain.crutd.provenance.prov_json_read import read_prov
from labweb.domain.errors import DefinitionError
from tests.corpus import NO_PROV, PROV
from tests.domain.crutd.provenance import prov_xml

pytestmark = pytest.mark.skipif(not PROV.is_dir(), reason=NO_PROV)

ROOT = Path(__file__).parents[4]
JSON = sorted((PROV / "json").glob("*.json"))
MALFORMED = sorted((PROV / "malformed").glob("*"))
JUDGED = sorted(p for p in (PROV / "unification").glob("*") if p.suffix != ".md")
CONTRADICTORY = {path.name for path in JSON if path.name.startswith("scruffy-")} | {
    # Well formed, but tells of the end of an activity and not of which.
    "end1.json",
}
"""Of the documents to be read: those with one name for two records, and one with a gap."""

CALLED_INVALID = {
    # Only an early draft of the Recommendation knew one usage of an entity by an activity. Since
    # then an activity may use a thing twice, at two times: there is no such constraint.
    "usage-fail5.xml",
    "usage-fail6.xml",
}
"""Documents that the corpus calls invalid and the Recommendation does not."""

CALLED_VALID = {
    # A delegation without the agent on whose behalf it is; PROV-DM requires one in each record,
    # as `delegation-fail5.xml` of the same corpus has it.
    "delegation-success3.xml",
}
"""Documents that the corpus calls valid and the Recommendation does not."""


def document_of(path: Path) -> bytes:
    return path.read_bytes() if path.suffix == ".json" else prov_xml.to_json(path)


def is_valid(path: Path) -> bool:
    valid = "-success" in path.name or "-PASS-" in path.name
    assert valid != ("-fail" in path.name or "-FAIL-" in path.name)
    return valid


def named(path: Path) -> str:
    return path.name


def test_the_corpus_is_whole() -> None:
    assert (len(JSON), len(MALFORMED), len(JUDGED)) == (45, 11, 116)


@pytest.mark.parametrize("path", JSON, ids=named)
def test_a_document_of_the_corpus_is_read_with_as_many_records_as_prov_finds(path: Path) -> None:
    mine = read_prov(path.read_bytes())
    theirs = ProvDocument.deserialize(path, format="json")
    assert len(mine.statements) == len(list(theirs.get_records()))


@pytest.mark.parametrize("path", JSON, ids=named)
def test_a_document_of_the_corpus_contradicts_itself_only_where_it_is_meant_to(path: Path) -> None:
    findings = check_prov(read_prov(path.read_bytes()))
    assert bool(findings) == (path.name in CONTRADICTORY), findings


@pytest.mark.parametrize("path", MALFORMED, ids=named)
def test_a_malformed_document_is_refused_with_findings(path: Path) -> None:
    with pytest.raises(DefinitionError) as refusal:
        read_prov(path.read_bytes())
    assert refusal.value.code == "prov.malformed"
    assert refusal.value.findings


@pytest.mark.parametrize("path", JUDGED, ids=named)
def test_a_document_is_judged_as_its_authors_judge_it(path: Path) -> None:
    findings = check_prov(read_prov(document_of(path)))
    is_excepted = path.name in CALLED_INVALID | CALLED_VALID
    assert (not findings) == (is_valid(path) != is_excepted), findings


def test_every_exception_is_in_the_corpus() -> None:
    named_so = {is_ok: {p.name for p in JUDGED if is_valid(p) == is_ok} for is_ok in (True, False)}
    assert named_so[False] >= CALLED_INVALID
    assert named_so[True] >= CALLED_VALID


def test_the_page_names_these_exceptions_and_no_other() -> None:
    page = (ROOT / "docs" / "provenance.md").read_text("utf-8")
    rows = re.findall(r"^\| (.+?) \| (valid|invalid) \| (?:valid|invalid) \|", page, re.MULTILINE)
    told = {(name, there) for names, there in rows for name in re.findall(r"`(.+?)`", names)}
    invalid = {(Path(name).stem, "invalid") for name in CALLED_INVALID}
    assert told == invalid | {(Path(name).stem, "valid") for name in CALLED_VALID}
